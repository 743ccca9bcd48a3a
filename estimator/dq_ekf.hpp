// Extended Kalman filter of a salient machine in rotor axes; the angle enters through the output.
//
//   state    x = [i_d, i_q, omega_e, theta_e]          A, A, rad/s, rad (electrical)
//   input    u = [u_alpha, u_beta]                     V, mean applied from t_{k-1} to t_k
//   output   y = [i_alpha, i_beta]                     A;  y = R(theta_e) [i_d; i_q]
//
// Model, x' = f(x, u), with [u_d; u_q] = R(-theta_e) [u_alpha; u_beta]:
//
//   L_d i_d' = u_d - R_s i_d + omega_e L_q i_q                                        Niewiara (10)
//   L_q i_q' = u_q - R_s i_q - omega_e (L_d i_d + psi_f)                                       (11)
//   omega_e' = 0                                                                          Dilys (3)
//   theta_e' = omega_e                                                                          (3)
//
// Fast step, every T_s, with a given K:
//
//   x^-   = x + T_s f(x, u)                            prediction = "euler"; also "rk4", "exact"
//   innov = R(-theta_e^-) y - [i_d^-; i_q^-]           the innovation in the predicted rotor axes
//   x     = x^- + K innov                              theta_e wrapped into [0, 2 pi)
//
// Background step, every n T_s, at the snapshot x; x^- is x one period later:
//
//         [1 - T_s R_s/L_d        T_s omega_e L_q/L_d   T_s L_q i_q/L_d             T_s u_q/L_d ]
//   F   = [-T_s omega_e L_d/L_q   1 - T_s R_s/L_q      -T_s (L_d i_d + psi_f)/L_q  -T_s u_d/L_q ]
//         [0                      0                     1                           0           ]
//         [0                      0                     T_s                         1           ]
//   H   = [1  0  0  -i_q^-]
//         [0  1  0   i_d^-]
//   P^- = F P F' + Q
//   K   = P^- H' (H P^- H' + R)^-1,  R = r I
//   P   = (I - K H) P^-                              covariance = "paper"
//   P   = (I - K H) P^- (I - K H)' + K R K'          any other form
//
// With R = r I this is the ordinary EKF, whose gain is K R(-theta_e^-). K itself does not age by
// rotation: at n > 1 no gain policy turns it. F needs the voltage: x_hat[4..5] carry u_dq of the
// last period, in the rotor axes of its middle.
// At standstill without current only omega_e is observable. With current the saliency shows the
// angle up to half a turn (docs/theory/ipmsm-filters.md).
// Q and R are discrete covariances of one background update: Q in A^2, A^2, (rad/s)^2, rad^2; r in
// A^2. A correction that is not finite is left out: the state keeps the prediction, status
// kNotFinite.
#pragma once
#include <utility>

#include "estimator/backemf_filter.hpp"

namespace twinrate {

struct DqEkfParameters {
  // Tuned at 2000 rpm and 0.6 of rated torque, noise 5 mA.
  double Q_diag[4] = {1e-4, 1e-4, 4, 1e-6};
  double r = 1e-3;
  double P0_diag[4] = {1e-2, 1e-2, 100, 3};
  void fields(FieldVisitor& f) {
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise per background update: A^2, A^2, (rad/s)^2, rad^2");
    f.number("R", r, 1e-15, 1e12, "measurement noise of either current, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance: A^2, A^2, (rad/s)^2, rad^2");
  }
};

class DqEkf final : public Ekf<4, 2, 2> {
 public:
  DqEkf(const MachineParameters& machine, const DqEkfParameters& tuning, Prediction prediction,
        CovarianceForm covariance, double T_s, KnownStart start);

  std::string_view kind() const override { return "dq_ekf"; }
  FastState start(const Measurement& first) const override;
  void align(FastState& state, double theta_e) const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override;
  Estimate ahead(const Estimate& snapshot, double ticks) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;

  State f(const State& x, const Vec2& u_alphabeta) const;
  State predict(const State& x, const Vec2& u_alphabeta) const;
  Covariance jacobian(const State& x, const Vec2& u_dq) const;  // I + F_c T_s
  static OutputMatrix output_jacobian(const State& x);          // in rotor axes

 private:
  std::pair<Covariance, OutputMatrix> linearised(const Estimate& snapshot) const;  // F, H
  State prior(const FastState& state, const Measurement& m) const override;
  Output innovation(const State& x_prior, const Measurement& m) const override;
  State wrapped(const State& x) const override;
  void describe(const FastState& state, const Measurement& m, Estimate& e) const override;
  // The voltage of the last period in the rotor axes of its middle.
  void remember(FastState& state, const State& x_prior, const Measurement& m,
                bool corrected) const override;

  MachineParameters machine_;
  Prediction prediction_;
  double T_s_;
  KnownStart start_;
};

}  // namespace twinrate
