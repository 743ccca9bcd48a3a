// Sensorless extended Kalman filter in the stationary frame (Dilys 2021, corrected), surface-magnet
// machine.
//
//   x = [i_alpha, i_beta, omega_e, theta_e],  u = u_alphabeta,  y = i_alphabeta,  H = [I 0] (5),
//   (7) i_alpha' = -R_s/L i_alpha + psi_f/L omega_e sin theta_e + u_alpha/L (6) i_beta'  = -R_s/L
//   i_beta  - psi_f/L omega_e cos theta_e + u_beta/L omega_e' = 0,  theta_e' = omega_e fast: x^- =
//   x + T f(x) + B u (Euler), or Runge-Kutta 4, or exact;  x = x^- + K (y - H x^-)  (13), (16),
//   (18) background: F = I + F_c T_s at the snapshot; P^- = F P F' + Q; K = P^- H'(H P^- H' +
//   R)^-1;       (11), (14), (17)
//               P = (I - K H) P^-  ("paper") or (I - K H) P^- (I - K H)' + K R K' ("joseph") (15)
//               or one output after the other ("sequential"); written out by hand in
//               kernels/ekf_sensorless_kernel.hpp
//
// F holds the control period T_s also when the background runs every n-th tick only; Q and R are
// discrete, per background update: A^2, (rad/s)^2, rad^2. L = L_d (the model has no saliency).
#pragma once
#include "estimator/covariance.hpp"
#include "estimator/filter.hpp"
#include "estimator/kernels/ekf_sensorless_kernel.hpp"
#include "model/discretise.hpp"
#include "model/machine.hpp"

namespace twinrate {

struct EkfSensorlessParameters {
  double Q_diag[4] = {1, 1, 500, 0.1};
  double R_diag[2] = {1, 1};
  double P0_diag[4] = {1, 1, 1, 1};
  void fields(FieldVisitor& f) {
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise a background update: A^2, A^2, (rad/s)^2, rad^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance: A^2, A^2, (rad/s)^2, rad^2");
  }
};

class EkfSensorless final : public Filter {
 public:
  using State = Eigen::Vector4d;
  using Covariance = Eigen::Matrix4d;
  using GainMatrix = Eigen::Matrix<double, 4, 2>;

  EkfSensorless(const MachineParameters& machine, const EkfSensorlessParameters& tuning,
                Prediction prediction, CovarianceForm covariance, double T_s,
                double omega_e_start = 0);

  std::string_view kind() const override { return "ekf_sensorless"; }
  FastState start(const Measurement& first) const override;
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override;
  void predict_over_gap(FastState& state, const Measurement& last) const override;
  void align(FastState& state, double theta_e) const override;
  Estimate output(const FastState& state, const Measurement& m) const override;
  Gain initial_gain() const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  int turning_pairs() const override { return 1; }
  Estimate ahead(const Estimate& snapshot, double ticks) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;
  // By doubling: kernels/riccati_doubling.hpp.
  Gain background_steps(const Gain& gain, double omega_m, int ticks) const override;

  // The equations by themselves.
  State f(const State& x, const Vec2& u_alphabeta) const;
  State predict(const State& x, const Vec2& u_alphabeta) const;
  Covariance jacobian(const State& x) const;  // I + F_c T_s

 private:
  double a_;  // R_s/L
  double b_;  // psi_f/L
  double inv_L_;
  int n_p_;
  double T_s_;
  double omega_e_start_;  // 0 from standstill, the known speed for a flying start
  Prediction prediction_;
  CovarianceForm covariance_;
  EkfSensorlessParameters tuning_;
  kernel::SensorlessConstants<double> constants_;
};

}  // namespace twinrate
