// Disturbance filter with a load that is periodic in the mechanical angle: each order is a harmonic
// oscillator, a pair of states.
//
//   state    x = [i_d, i_q, omega_m, T_0, a_1, b_1, .., a_m, b_m]     A, A, rad/s, Nm, Nm ..
//   input    u = [u_d, u_q]                            V, mean applied from t_{k-1} to t_k
//   output   y = [i_d, i_q, omega_m]                   A, A, rad/s;  y = C x, C = [I 0]
//
// n_x = 4 + 2 m with m <= 10 orders N_1 .. N_m (periods per mechanical turn). Model:
//
//   L_d i_d'   = u_d - R_s i_d + n_p omega_m L_q i_q                                  Niewiara (10)
//   L_q i_q'   = u_q - R_s i_q - n_p omega_m (L_d i_d + psi_f)                                 (11)
//   J omega_m' = 3/2 n_p (psi_f + (L_d - L_q) i_d) i_q - T_o                                   (12)
//   T_o        = T_0 + sum_j a_j + T_known(theta_m)    the load; positive opposes the motion
//   T_0'       = 0                                                                             (20)
//   a_j'       =  N_j omega_m b_j                      so a_j = A_j sin(N_j theta_m + phase_j)
//   b_j'       = -N_j omega_m a_j
//
// Fast step, every T_s, with a given K; dtheta_m is the measured change of the angle:
//
//   [a_j; b_j]^- = R(-N_j dtheta_m) [a_j; b_j]         exact rotation
//   x^-[0..3]    as estimator/ekf_disturbance.hpp predicts, T_o taken in mid-interval          (24)
//   innov        = y - C x^-
//   T_0^-        = T_0 + L T_s innov_omega_m                                                   (25)
//   x            = x^- + K innov                                                               (23)
//
// Background step, every n T_s, at the snapshot x:
//
//         [F of estimator/ekf_disturbance.hpp   -T_s/J in row omega_m, column a_j, for each j]
//   F   = [0                                     block diagonal, R(-N_j omega_m T_s) for each j ]
//   P^- = F P F' + Q                                                                           (26)
//   K   = P^- C' (C P^- C' + R)^-1                                                             (27)
//   P   = (I - K C) P^- (I - K C)' + K R K'            covariance = "joseph"
//   P   = P^- - K C P^-                                any other form                          (28)
//   P   is then made symmetric: (P + P')/2
//
// The rate of the load is dT_o/dt = sum_j N_j omega_m b_j + the rate of T_known. It is published: a
// controller with a known lag can feed the load forward that much ahead. The gain hardly depends on
// the angle, because each oscillator turns in its own frame; so f_b may be low. With no orders this
// is the filter of the paper.
// Phase currents, voltages and a position sensor are needed. A sample without one of them is
// predicted over. Q and R are discrete covariances of one background update, units as above.
// Source: Niewiara 2020 for the first four states; docs/theory/disturbance-ekf.md for the rest.
#pragma once
#include "estimator/ekf_disturbance.hpp"

namespace twinrate {

inline constexpr int kMostOrders = (kMaxStates - 4) / 2;

struct EkfHarmonicParameters {
  std::vector<int> orders{1, 3, 6, 12, 18, 27, 36, 54};
  double Q_diag[4] = {1.0, 2.0, 1.5, 0.1};
  double Q_order = 1e-3;
  double R_diag[3] = {10.0, 10.0, 150.0};
  double P0_diag[4] = {1, 1, 1, 1};
  double P0_order = 1;
  double L = 0;
  void fields(FieldVisitor& f) {
    f.integers("orders", orders, 1, 2000, kMostOrders,
               "orders of the load, periods per mechanical turn");
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise per background update: A^2, A^2, (rad/s)^2, (Nm)^2");
    f.number("Q_order_Nm2", Q_order, 0, 1e12, "process noise of each oscillator state");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2, (rad/s)^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance, same units as Q_diag");
    f.number("P0_order_Nm2", P0_order, 0, 1e12, "initial covariance of each oscillator state");
    f.number("L_Nm_rad", L, -1e6, 0, "gain of the integral of the speed tracking error, (25)");
  }
};

class EkfHarmonic final : public Filter {
 public:
  // A state for each order, without allocation.
  using State = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxStates, 1>;
  using Covariance =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxStates>;

  EkfHarmonic(const MachineParameters& machine, const EkfHarmonicParameters& tuning,
              Prediction prediction, CovarianceForm covariance, double T_s);

  std::string_view kind() const override { return "ekf_harmonic"; }
  FastState start(const Measurement& first) const override;
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override;
  void predict_over_gap(FastState& state, const Measurement& last) const override;
  Estimate output(const FastState& state, const Measurement& m) const override;
  bool estimates_load() const override { return true; }
  Gain initial_gain() const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override;

  std::optional<Estimate> steady_state(double omega_m) const override;

  // Prediction over T_s while the rotor turns by dtheta_m; `T_known` is the part of the load that
  // is no state.
  State predict(const State& x, const Vec2& u_dq, double dtheta_m, double T_known) const;
  Covariance jacobian(const State& x) const;
  int n_x() const { return 4 + 2 * static_cast<int>(orders_.size()); }

 private:
  OperatingPoint point(const State& x, double theta_m, double t) const;

  MachineParameters machine_;
  std::vector<int> orders_;
  State Q_diag_, P0_diag_;
  Eigen::Vector3d R_diag_;
  double L_;
  EkfDisturbance drive_;  // the equations of currents and speed
  CovarianceForm covariance_;
  double T_s_;
};

}  // namespace twinrate
