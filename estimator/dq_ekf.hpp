// Extended Kalman filter of a salient machine in rotor axes; the angle enters through the output.
//
//   x = [i_d, i_q, omega_e, theta_e],  u = u_alphabeta,  y = i_alphabeta = R(theta_e) i_dq
//   L_d i_d' = u_d - R_s i_d + omega_e L_q i_q                        u_dq = R(-theta_e)
//   u_alphabeta L_q i_q' = u_q - R_s i_q - omega_e (L_d i_d + psi_f),  omega_e' = 0,  theta_e' =
//   omega_e fast:       x = x^- + K innov,  innov = R(-theta_e^-) y - i_dq^- background: F = I +
//   F_c T_s at the snapshot, P^- = F P F' + Q, x^- = one period on,
//               H = [1 0 0 -i_q^-; 0 1 0 i_d^-],  K, P as ever
//
// The innovation is turned into the predicted rotor axes. With R = r I that is the ordinary EKF
// (its K is this one times R(-theta_e^-)), and the gain does not grow old by rotation: at n > 1 it
// needs no turning, whatever the gain policy. F needs the voltage: x_hat[4..5] carry u_dq of the
// last period, in the rotor axes of its middle. At standstill without current nothing is observable
// but omega_e; with current the saliency shows the angle up to half a turn
// (docs/theory/ipmsm-filters.md). Q and R are discrete, per background update.
#pragma once
#include "estimator/backemf_filter.hpp"

namespace twinrate {

struct DqEkfParameters {
  // Tuned at 2000 rpm and 0.6 of rated torque, noise 5 mA.
  double Q_diag[4] = {1e-4, 1e-4, 4, 1e-6};
  double r = 1e-3;
  double P0_diag[4] = {1e-2, 1e-2, 100, 3};
  void fields(FieldVisitor& f) {
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise a background update: A^2, A^2, (rad/s)^2, rad^2");
    f.number("R", r, 1e-15, 1e12, "measurement noise of either current, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance: A^2, A^2, (rad/s)^2, rad^2");
  }
};

class DqEkf final : public Filter {
 public:
  using State = Eigen::Vector4d;

  DqEkf(const MachineParameters& machine, const DqEkfParameters& tuning, Prediction prediction,
        CovarianceForm covariance, double T_s, KnownStart start);

  std::string_view kind() const override { return "dq_ekf"; }
  FastState start(const Measurement& first) const override;
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override;
  void predict_over_gap(FastState& state, const Measurement& last) const override;
  void align(FastState& state, double theta_e) const override;
  Estimate output(const FastState& state, const Measurement& m) const override;
  Gain initial_gain() const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  Estimate ahead(const Estimate& snapshot, double ticks) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;

  State f(const State& x, const Vec2& u_alphabeta) const;
  State predict(const State& x, const Vec2& u_alphabeta) const;
  Eigen::Matrix4d jacobian(const State& x, const Vec2& u_dq) const;    // I + F_c T_s
  static Eigen::Matrix<double, 2, 4> output_jacobian(const State& x);  // in rotor axes

 private:
  MachineParameters machine_;
  DqEkfParameters tuning_;
  Prediction prediction_;
  CovarianceForm covariance_;
  double T_s_;
  KnownStart start_;
};

}  // namespace twinrate
