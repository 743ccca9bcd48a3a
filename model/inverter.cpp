#include "model/inverter.hpp"

#include "model/fields.hpp"

namespace twinrate {

void InverterParameters::fields(FieldVisitor& f) {
  f.number("v_dc_V", v_dc, 1, 2000, "DC-bus voltage", Presence::kRequired);
  f.number("f_pwm_Hz", f_pwm, 0, 1e6, "switching frequency; 0: the control rate");
}

Vec2 mean_voltage(const Vec3& duty_abc, double v_dc) {
  return clarke(duty_abc * v_dc);
}

[[gnu::flatten]] InverterOutput svpwm(const Vec2& u_alphabeta_ref, double v_dc) {
  InverterOutput out;
  Vec3 u_abc = inverse_clarke(u_alphabeta_ref);
  const double span = u_abc.maxCoeff() - u_abc.minCoeff();
  if (span > v_dc) {  // the hexagon is where the largest line-to-line voltage equals v_dc
    u_abc *= v_dc / span;
    out.limited = true;
  }
  const double zero_sequence = -0.5 * (u_abc.maxCoeff() + u_abc.minCoeff());
  for (int phase = 0; phase < 3; ++phase) {
    const double duty = 0.5 + (u_abc[phase] + zero_sequence) / v_dc;
    out.duty_abc[phase] = duty < 0 ? 0 : duty > 1 ? 1 : duty;
  }
  out.u_alphabeta = mean_voltage(out.duty_abc, v_dc);
  return out;
}

}  // namespace twinrate
