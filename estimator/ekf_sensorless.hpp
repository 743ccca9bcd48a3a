// Sensorless extended Kalman filter in the stationary frame, for a surface-magnet machine.
//
//   state    x = [i_alpha, i_beta, omega_e, theta_e]   A, A, rad/s, rad (electrical)            (5)
//   input    u = [u_alpha, u_beta]                     V, mean applied from t_{k-1} to t_k      (5)
//   output   y = [i_alpha, i_beta]                     A;  y = H x, H = [I 0], 2 by 4      (5), (7)
//
// Model, x' = f(x, u), with L = L_d (the model has no saliency):
//
//   i_alpha' = -R_s/L i_alpha + psi_f/L omega_e sin theta_e + u_alpha/L                    (3), (6)
//   i_beta'  = -R_s/L i_beta  - psi_f/L omega_e cos theta_e + u_beta/L                     (3), (6)
//   omega_e' = 0                                                                           (3), (6)
//   theta_e' = omega_e                                                                     (3), (6)
//
// Fast step, every T_s, with a given K:
//
//   x^-   = x + T_s f(x, u)            prediction = "euler"; "rk4" and "exact" likewise        (13)
//   innov = y - H x^-
//   x     = x^- + K innov              theta_e wrapped into [0, 2 pi)                    (16), (18)
//
// Background step, every n T_s, at the snapshot x:
//
//         [1 - T_s R_s/L  0              T_s psi_f/L sin theta_e   T_s psi_f/L omega_e cos theta_e]
//   F   = [0              1 - T_s R_s/L -T_s psi_f/L cos theta_e   T_s psi_f/L omega_e sin theta_e]
//         [0              0              1                         0                              ]
//         [0              0              T_s                       1                              ]
//       = I + F_c T_s                                                                     (9), (11)
//   P^- = F P F' + Q                                                                           (14)
//   K   = P^- H' (H P^- H' + R)^-1                                                             (17)
//   P   = (I - K H) P^-                              covariance = "paper"                      (15)
//   P   = (I - K H) P^- (I - K H)' + K R K'          covariance = "joseph"
//
// covariance = "sequential" corrects with one output after the other: the same K and P without the
// inverse. "auto" chooses between it and "joseph" (estimator/covariance_form.hpp).
// kernels/ekf_sensorless_kernel.hpp holds all of it, written out by hand.
//
// F holds the control period T_s at every n. Q and R are discrete covariances of one background
// update: Q in A^2, A^2, (rad/s)^2, rad^2; R in A^2, A^2. They do not scale with T_s or n.
// A correction that is not finite is left out: the state keeps the prediction, status kNotFinite.
// Source: Dilys 2021, corrected (docs/theory/two-rate-ekf.md, "Errata of the paper").
#pragma once
#include "estimator/ekf.hpp"
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
              "process noise per background update: A^2, A^2, (rad/s)^2, rad^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance: A^2, A^2, (rad/s)^2, rad^2");
  }
};

class EkfSensorless final : public Ekf<4, 2> {
 public:
  EkfSensorless(const MachineParameters& machine, const EkfSensorlessParameters& tuning,
                Prediction prediction, CovarianceForm covariance, double T_s,
                double omega_e_start = 0);

  std::string_view kind() const override { return "ekf_sensorless"; }
  double direct_start_within() const override { return kStartWithin; }
  FastState start(const Measurement& first) const override;
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override;
  void align(FastState& state, double theta_e) const override;
  void output_of_tick(FastState& state, const Measurement& m, Estimate& e) const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override;
  void update_gain(Gain& gain, const Estimate& snapshot) const override;
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
  friend Ekf;
  // `at`: sine and cosine of x[3].
  State predict_at(const State& x, const kernel::UnitVector<double>& at,
                   const Vec2& u_alphabeta) const;
  State prior(const FastState& state, const Measurement& m) const override;
  Output innovation(const State& x_prior, const Measurement& m) const override;
  State wrapped(const State& x) const override;
  void describe(const FastState& state, const Measurement& m, Estimate& e) const override;

  double a_;  // R_s/L
  double b_;  // psi_f/L
  double inv_L_;
  int n_p_;
  double T_s_;
  double omega_e_start_;  // 0 from standstill, the known speed for a flying start
  Prediction prediction_;
  kernel::SensorlessConstants<double> constants_;
};

}  // namespace twinrate
