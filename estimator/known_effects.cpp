#include "estimator/known_effects.hpp"

namespace twinrate {

KnownEffects::KnownEffects(const Effects& effects, int n_p, int current_sensors, double T_s)
    : undo_(effects, n_p, current_sensors, T_s),
      torque_(acting_on(effects, kOnTorque)),
      voltage_(acting_on(effects, kOnVoltage)),
      none_(effects.empty()),
      n_p_(n_p),
      T_s_(T_s) {}

Measurement KnownEffects::seen(const Measurement& m, const Estimate& last) const {
  Measurement s = undo_(m);
  if (voltage_.empty() || last.k < 0 || !(m.signals & kVoltage)) return s;
  // Middle of the interval in which the voltage acted.
  const double theta_m = s.theta_m - 0.5 * T_s_ * last.omega_m;
  const double theta_e = last.theta_e + 0.5 * T_s_ * last.omega_m * n_p_;
  const OperatingPoint point{.t = 1e-9 * static_cast<double>(m.t_ns),
                             .i_dq = last.i_dq,
                             .u_dq = park(m.u_alphabeta, theta_e),
                             .v_dc = m.v_dc,
                             .omega_m = last.omega_m,
                             .theta_m = theta_m,
                             .theta_e = theta_e};
  s.u_alphabeta -= inverse_park(predicted_drop(voltage_, point), theta_e);
  return s;
}

}  // namespace twinrate
