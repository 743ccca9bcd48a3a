// Extended-EMF filter of a salient machine, stationary frame, speed as a state.
//
//   x = [i_alpha, i_beta, e_alpha, e_beta, omega_e],  u = u_alphabeta,  y = i_alphabeta,  H = [I 0]
//   L_d i_alpha' = u_alpha - R_s i_alpha - omega_e (L_d - L_q) i_beta  - e_alpha
//   L_d i_beta'  = u_beta  - R_s i_beta  + omega_e (L_d - L_q) i_alpha - e_beta
//   e_alpha' = -omega_e e_beta,  e_beta' = omega_e e_alpha,  omega_e' = 0
//   e = E_ex [-sin theta_e; cos theta_e],  E_ex = omega_e psi_f + (L_d - L_q)(omega_e i_d - i_q')
//   theta_e = atan2(-e_alpha, e_beta), turned by pi where omega_e < 0
//
// The model is exact for a salient rotor; e is taken to keep its length over one period. At
// standstill e = 0 and the angle is nowhere in it: start with "align_if". prediction = euler has a
// constant angle error of about omega_e T_s/2, rk4 and exact have none. Source: Chen, Tomita, Doki,
// Okuma 2003, extended EMF; docs/theory/ipmsm-filters.md.
#pragma once
#include "estimator/backemf_filter.hpp"

namespace twinrate {

struct EemfParameters {
  // Tuned at 2000 rpm and 0.6 of rated torque, noise 5 mA.
  double Q_diag[5] = {1e-4, 1e-4, 0.5, 0.5, 4};
  double R_diag[2] = {1e-3, 1e-3};
  double P0_diag[5] = {1e-2, 1e-2, 100, 100, 100};
  Rotation rotation = Rotation::kExact;
  void fields(FieldVisitor& f) {
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise a background update: A^2, A^2, V^2, V^2, (rad/s)^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance: A^2, A^2, V^2, V^2, (rad/s)^2");
    choice(f, "rotation", rotation, kRotationNames,
           "how the EMF turns over one period (prediction = euler)");
  }
};

class Eemf final : public Filter {
 public:
  using State = Eigen::Matrix<double, 5, 1>;
  using Covariance = Eigen::Matrix<double, 5, 5>;

  Eemf(const MachineParameters& machine, const EemfParameters& tuning, Prediction prediction,
       CovarianceForm covariance, double T_s, KnownStart start);

  std::string_view kind() const override { return "eemf"; }
  FastState start(const Measurement& first) const override;
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override;
  void predict_over_gap(FastState& state, const Measurement& last) const override;
  void align(FastState& state, double theta_e) const override;
  Estimate output(const FastState& state, const Measurement& m) const override;
  Gain initial_gain() const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  int turning_pairs() const override { return 2; }  // i and e
  Estimate ahead(const Estimate& snapshot, double ticks) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;

  State f(const State& x, const Vec2& u_alphabeta) const;
  State predict(const State& x, const Vec2& u_alphabeta) const;
  Covariance jacobian(const State& x) const;  // of the Euler prediction, with its rotation

 private:
  MachineParameters machine_;
  EemfParameters tuning_;
  Prediction prediction_;
  CovarianceForm covariance_;
  double T_s_;
  KnownStart start_;
};

}  // namespace twinrate
