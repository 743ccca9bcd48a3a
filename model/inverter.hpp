// Averaged two-level inverter with space-vector modulation (SVPWM).
//
// The reference is limited to the voltage hexagon (amplitude 2/3 v_dc at the corners, v_dc/sqrt3 at
// the flats); its angle is kept. Zero-sequence injection min-max/2 gives the duty cycles. The mean
// voltage applied is the Clarke transform of duty * v_dc.
#pragma once
#include "model/frames.hpp"

namespace twinrate {

class FieldVisitor;

struct InverterParameters {
  double v_dc = 0;
  double f_pwm = 0;
  void fields(FieldVisitor& f);
  // Largest amplitude the modulator gives at every angle.
  double u_max_linear() const { return v_dc * std::numbers::inv_sqrt3; }
};

struct InverterOutput {
  Vec3 duty_abc;
  Vec2 u_alphabeta;      // mean applied, V
  bool limited = false;  // the reference was outside the hexagon
};

// Of duty cycles (0..1) on a DC-bus voltage: clarke(duty v_dc), the zero sequence drops out.
inline Vec2 mean_voltage(const Vec3& duty_abc, double v_dc) {
  return clarke(duty_abc * v_dc);
}

inline void svpwm(const Vec2& u_alphabeta_ref, double v_dc, InverterOutput& out) {
  Vec3 u_abc = inverse_clarke(u_alphabeta_ref);
  const double span = u_abc.maxCoeff() - u_abc.minCoeff();
  out.limited = span > v_dc;
  // The limit is the hexagon, on which the largest line-to-line voltage equals v_dc.
  if (out.limited) u_abc *= v_dc / span;
  const double zero_sequence = -0.5 * (u_abc.maxCoeff() + u_abc.minCoeff());
#pragma GCC unroll 3
  for (int phase = 0; phase < 3; ++phase) {
    const double duty = 0.5 + (u_abc[phase] + zero_sequence) / v_dc;
    out.duty_abc[phase] = duty < 0 ? 0 : duty > 1 ? 1 : duty;
  }
  const Vec2 u_alphabeta = mean_voltage(out.duty_abc, v_dc);
  out.u_alphabeta[0] = u_alphabeta[0];
  out.u_alphabeta[1] = u_alphabeta[1];
}
inline InverterOutput svpwm(const Vec2& u_alphabeta_ref, double v_dc) {
  InverterOutput out;
  svpwm(u_alphabeta_ref, v_dc, out);
  return out;
}

}  // namespace twinrate
