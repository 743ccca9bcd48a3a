// Disturbance filter whose load is periodic in the mechanical angle: harmonic oscillators as
// states.
//
//   x = [i_d, i_q, omega_m, T_0, a_1, b_1, .., a_m, b_m],  u = u_dq,  y = [i_d, i_q, omega_m]
//   T_o = T_0 + sum_j a_j + T_known(theta_m)                         the load that opposes the
//   motion first three equations as in estimator/ekf_disturbance.hpp (10)-(12), T_0' = 0 with (25)
//   [a_j; b_j]' = N_j omega_m [0 1; -1 0] [a_j; b_j]                 a_j = A sin(N_j theta_m +
//   phase) fast:        oscillators turned by N_j times the measured change of angle, then
//                x = x^- + K (y - C x^-)
//   background:  P^- = F P F' + Q, K and P as in the other filters; n_x = 4 + 2 m, m <= 10
//
// In a turning frame the gain hardly depends on the angle, so the background may be slow. The rate
// of the load is known, dT_o/dt = sum_j N_j omega_m b_j, and published: a controller that knows its
// own lag can feed the load forward ahead of time. The paper's filter is the one with no orders.
// Needs phase currents, voltages and a position sensor; a sample without one of them is predicted
// over. Q and R are discrete, per background update.
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
    f.integers("orders", orders, 1, 2000, kMostOrders, "periods a mechanical turn of the load");
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise a background update: A^2, A^2, (rad/s)^2, (Nm)^2");
    f.number("Q_order_Nm2", Q_order, 0, 1e12, "process noise of each oscillator state");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2, (rad/s)^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance, same units as Q_diag");
    f.number("P0_order_Nm2", P0_order, 0, 1e12, "initial covariance of each oscillator state");
    f.number("L_Nm_rad", L, -1e6, 0, "gain of the integral of the speed tracking error, (25)");
  }
};

class EkfHarmonic final : public Filter {
 public:
  // As many states as there are orders, without allocation.
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
  Gain initial_gain() const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;

  std::optional<Estimate> steady_state(double omega_m) const override;

  // Prediction over T_s while the rotor turns by dtheta_m; `T_known` is the part of the load that
  // is no state.
  State predict(const State& x, const Vec2& u_dq, double dtheta_m, double T_known) const;
  Covariance jacobian(const State& x) const;
  int n_x() const { return 4 + 2 * static_cast<int>(tuning_.orders.size()); }

 private:
  OperatingPoint point(const State& x, double theta_m, double t) const;

  MachineParameters machine_;
  EkfHarmonicParameters tuning_;
  EkfDisturbance drive_;  // the equations of currents and speed
  CovarianceForm covariance_;
  double T_s_;
};

}  // namespace twinrate
