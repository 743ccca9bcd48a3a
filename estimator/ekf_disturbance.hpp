// Disturbance extended Kalman filter in rotor axes: the load torque is a state.
//
//   state    x = [i_d, i_q, omega_m, T_o]              A, A, rad/s (mechanical), Nm            (19)
//   input    u = [u_d, u_q]                            V, mean applied from t_{k-1} to t_k
//   output   y = [i_d, i_q, omega_m]                   A, A, rad/s; y = C x, C = [I 0], 3 by 4 (22)
//
// Model, x' = f(x, u):
//
//   L_d i_d'   = u_d - R_s i_d + n_p omega_m L_q i_q                                           (10)
//   L_q i_q'   = u_q - R_s i_q - n_p omega_m (L_d i_d + psi_f)                                 (11)
//   J omega_m' = 3/2 n_p (psi_f + (L_d - L_q) i_d) i_q - T_o                                   (12)
//   T_o'       = 0                                                                             (20)
//
// Fast step, every T_s, with a given K:
//
//   x^-   = x + T_s f(x, u)            prediction = "euler"; "rk4"; "exact" at frozen omega_m  (24)
//   T_o^- = T_o + L T_s (omega_m - omega_m^-)          omega_m: measured                       (25)
//   innov = y - C x^-
//   x     = x^- + K innov                                                                      (23)
//
// Background step, every n T_s, at the snapshot x, with omega_e = n_p omega_m,
// k_R = 3/2 n_p (L_d - L_q) and k_T = 3/2 n_p (psi_f + (L_d - L_q) i_d):
//
//         [1 - T_s R_s/L_d         T_s omega_e L_q/L_d   T_s n_p L_q i_q/L_d              0     ]
//   F   = [-T_s omega_e L_d/L_q    1 - T_s R_s/L_q      -T_s n_p (L_d i_d + psi_f)/L_q    0     ]
//         [T_s k_R i_q/J           T_s k_T/J             1                               -T_s/J ]
//         [0                       0                     0                                1     ]
//   P^- = F P F' + Q                                                                           (26)
//   K   = P^- C' (C P^- C' + R)^-1                                                             (27)
//   P   = (I - K C) P^-                              covariance = "paper"                      (28)
//   P   = (I - K C) P^- (I - K C)' + K R K'          covariance = "joseph"
//
// covariance = "sequential" corrects with one output after the other: kernels/ekf_dq_kernel.hpp.
// "auto" chooses between it and "joseph" (estimator/covariance_form.hpp).
//
// Reduced filter, for a log without voltages; its inputs are the measured currents:
//
//   state    x = [omega_m, T_o],  input u = [i_d, i_q],  output y = omega_m
//   omega_m^- = omega_m + T_s/J (T_em(u) - T_o)        u: mean of the last two samples         (12)
//   innov     = y - omega_m^-
//   T_o^-     = T_o + L T_s innov                                                              (25)
//   x         = x^- + K innov                                                                  (23)
//   F         = [1 -T_s/J; 0 1],  C = [1 0]
//
// u_dq = R(-theta_e) u_alphabeta with theta_e in the middle of the interval. Friction is part of
// T_o, as in the paper. The torque of known effects adds to T_o in the prediction and in T_load of
// the estimate; the state T_o is the remaining load.
// Q and R are discrete covariances of one background update: Q in A^2, A^2, (rad/s)^2, (Nm)^2; R in
// A^2, A^2, (rad/s)^2. L in Nm/rad, negative.
// A correction that is not finite is left out: the state keeps the prediction, status kNotFinite.
// Source: Niewiara 2020, corrected (docs/theory/disturbance-ekf.md, "Errata of the paper").
#pragma once
#include "estimator/ekf.hpp"
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
              "process noise per background update: A^2, A^2, (rad/s)^2, (Nm)^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2, (rad/s)^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance, same units as Q_diag");
    f.number("L_Nm_rad", L, -1e6, 0, "gain of the integral of the speed tracking error, (25)");
    f.boolean("speed_from_angle", speed_from_angle,
              "compute the speed as the difference of the angle over T_s instead of the speed of "
              "the sensor; a simulated encoder computes it so, too");
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
  bool estimates_load() const override { return true; }
  Gain initial_gain() const override;
  Gain initial_gain_without_voltage() const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override;
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
  Gain sequential_step(const Gain& previous, const Estimate& snapshot) const;
  Correction reduced_step(FastState& state, const Measurement& m, const Gain& gain) const;

  MachineParameters machine_;
  EkfTuning<4, 3> full_;
  EkfTuning<2, 1> reduced_;
  double L_;
  bool speed_from_angle_;
  Prediction prediction_;
  double T_s_;
};

}  // namespace twinrate
