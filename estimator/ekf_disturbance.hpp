// Disturbance extended Kalman filter in rotor axes (Niewiara 2020, corrected): overall load torque
// as a state.
//
//   x = [i_d, i_q, omega_m, T_o],  u = u_dq,  y = [i_d, i_q, omega_m] (19), (22) L_d i_d' = u_d -
//   R_s i_d + n_p omega_m L_q i_q                                                  (10) L_q i_q' =
//   u_q - R_s i_q - n_p omega_m (L_d i_d + psi_f)                                        (11) J
//   omega_m' = 3/2 n_p (psi_f + (L_d - L_q) i_d) i_q - T_o,  T_o' = 0 (12), (20) fast:       x^- =
//   x + T f (Euler = (24)), Runge-Kutta 4 or exact at frozen omega_m;
//               T_o^- = T_o + L T_s (omega_m - omega_m^-);  x = x^- + K (y - C x^-) (25), (23)
//   background: P^- = F P F' + Q, K by (27), P by (28) or Joseph
//
// Where a log holds no voltages the measured currents are inputs and the filter reduces to
//   x = [omega_m, T_o],  y = omega_m,  J omega_m' = T_em(mean of the two last i_dq) - T_o
// Friction is part of T_o (as in the paper). Q and R are discrete, per background update.
#pragma once
#include "estimator/covariance.hpp"
#include "estimator/filter.hpp"
#include "model/discretise.hpp"
#include "model/machine.hpp"

namespace twinrate {

struct EkfDisturbanceParameters {
  double Q_diag[4] = {1.0, 2.0, 1.5, 0.1};  // (29)
  double R_diag[3] = {10.0, 10.0, 150.0};   // (30)
  double P0_diag[4] = {1, 1, 1, 1};
  double L = -700;  // Table 1
  bool speed_from_angle = false;
  void fields(FieldVisitor& f) {
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise a background update: A^2, A^2, (rad/s)^2, (Nm)^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2, (rad/s)^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance, same units as Q_diag");
    f.number("L_Nm_rad", L, -1e6, 0, "gain of the integral of the speed tracking error, (25)");
    f.boolean(
        "speed_from_angle", speed_from_angle,
        "measure speed as the difference of the angle over T_s, not as the sensor reports it");
  }
};

class EkfDisturbance final : public Filter {
 public:
  using State = Eigen::Vector4d;

  EkfDisturbance(const MachineParameters& machine, const EkfDisturbanceParameters& tuning,
                 Prediction prediction, CovarianceForm covariance, double T_s);

  std::string_view kind() const override { return "ekf_disturbance"; }
  FastState start(const Measurement& first) const override;
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override;
  void predict_over_gap(FastState& state, const Measurement& last) const override;
  Estimate output(const FastState& state, const Measurement& m) const override;
  Gain initial_gain() const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;

  State f(const State& x, const Vec2& u_dq) const;
  State predict(const State& x, const Vec2& u_dq) const;
  Eigen::Matrix4d jacobian(const State& x) const;  // I + df/dx T_s

 private:
  Vec2 currents(const Measurement& m) const;
  OperatingPoint point(const Vec2& i_dq, double omega_m, double theta_m, std::int64_t t_ns) const;
  State predict_known(const State& x, const Vec2& u_dq, double theta_m, std::int64_t t_ns) const;
  double measured_speed(const FastState& state, const Measurement& m) const;
  Correction full_step(FastState& state, const Measurement& m, const Gain& gain) const;
  // covariance = "sequential": kernels/ekf_dq_kernel.hpp.
  Gain sequential_step(const Gain& previous, const Estimate& snapshot,
                       const Eigen::Matrix4d& P) const;
  Correction reduced_step(FastState& state, const Measurement& m, const Gain& gain) const;

  MachineParameters machine_;
  EkfDisturbanceParameters tuning_;
  Prediction prediction_;
  CovarianceForm covariance_;
  double T_s_;
};

}  // namespace twinrate
