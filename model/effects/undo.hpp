// The inverse of effects: the readings without the effects on the sensors, and the voltage that is
// lost on its way to the machine. For estimators and controllers that know an effect.
//
// Sensing effects are given as reading = true + c(true); undone by the fixed point
//   i_abc <- i_abc_meas - c(i_abc, theta_m),  theta_m <- theta_m_meas - c(theta_m)
// in three rounds, each of which reduces the error by the factor of the effect's slope (a gain of 2
// %: 8e-6 of the error). With two current sensors i_c is -(i_a + i_b). A speed from the difference
// of two angles over T_s is corrected by the same difference of c(theta_m). No allocation; a
// measurement without the signal in question is unchanged.
//
// Late signals (signal_lag) are extrapolated from t_k - lag to t_k at the given speed: the angle by
// omega_m lag, the current vector by a turn of n_p omega_m lag, as in steady state. A filter of
// time constant lag counts as that delay. A late speed is unchanged.
#pragma once
#include "model/effects/effect.hpp"
#include "model/signals.hpp"

namespace twinrate {

class SensingUndo {
 public:
  // `effects`: all the drive's model effects; those on currents and angle are picked out.
  SensingUndo(const Effects& effects, int n_p, int current_sensors, double T_s);

  bool nothing_to_do() const {
    return on_currents_.empty() && on_angle_.empty() && current_lag_ == 0 && angle_lag_ == 0;
  }
  Measurement operator()(const Measurement& m) const { return (*this)(m, m.omega_m); }
  // `omega_m`: a better speed than the measured one, for late signals.
  Measurement operator()(const Measurement& m, double omega_m) const;
  double current_lag() const { return current_lag_; }  // s

 private:
  double true_angle(double theta_m_meas, OperatingPoint& point) const;
  double angle_error(double theta_m, OperatingPoint& point) const;

  Effects on_currents_, on_angle_;
  int n_p_, current_sensors_;
  double T_s_;
  double current_lag_ = 0, angle_lag_ = 0;  // s
};

// Voltage loss of `effects` in rotor axes, at a point that is filled in. To be added to the
// request.
inline Vec2 predicted_drop(const Effects& effects, const OperatingPoint& point) {
  return sum_at(effects, point).u_dq_drop;
}

// The same plus the EMF of effects on the flux at constant current: omega_e [-psi_q, psi_d].
inline Vec2 predicted_drop_and_emf(const Effects& effects, const OperatingPoint& point, int n_p) {
  const Contribution c = sum_at(effects, point);
  return c.u_dq_drop + n_p * point.omega_m * Vec2(-c.psi_dq[1], c.psi_dq[0]);
}

// Load torque of `effects` there, less the torque that their flux makes.
inline double known_load(const Effects& effects, const OperatingPoint& point, int n_p) {
  const Contribution c = sum_at(effects, point);
  return c.T_load - 1.5 * n_p * (c.psi_dq[0] * point.i_dq[1] - c.psi_dq[1] * point.i_dq[0]);
}

}  // namespace twinrate
