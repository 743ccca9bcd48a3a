// Extended-EMF filter of a salient machine in the stationary frame, with the speed as a state.
//
//   state    x = [i_alpha, i_beta, e_alpha, e_beta, omega_e]     A, A, V, V, rad/s (electrical)
//   input    u = [u_alpha, u_beta]                     V, mean applied from t_{k-1} to t_k
//   output   y = [i_alpha, i_beta]                     A;  y = H x, H = [I 0], 2 by 5
//
// Model, x' = f(x, u):
//
//   L_d i_alpha' = u_alpha - R_s i_alpha - omega_e (L_d - L_q) i_beta  - e_alpha
//   L_d i_beta'  = u_beta  - R_s i_beta  + omega_e (L_d - L_q) i_alpha - e_beta
//   e_alpha'     = -omega_e e_beta
//   e_beta'      =  omega_e e_alpha
//   omega_e'     = 0
//
// The extended EMF holds the angle; theta_e is no state:
//
//   e       = E_ex [-sin theta_e; cos theta_e]
//   E_ex    = omega_e psi_f + (L_d - L_q) (omega_e i_d - i_q')
//   theta_e = atan2(-e_alpha, e_beta)                  plus pi where omega_e < 0
//
// Fast step, every T_s, with a given K:
//
//   x^-   = x + T_s f(x, u)            prediction = "euler", e turned by R(omega_e T_s) where
//                                      rotation = "exact"; also "rk4", "exact" at frozen omega_e
//   innov = y - H x^-
//   x     = x^- + K innov
//
// Background step, every n T_s, at the snapshot x, with a = T_s R_s/L_d, b = T_s/L_d,
// s = T_s (L_d - L_q)/L_d. rotation = "exact": c = cos(omega_e T_s), d = sin(omega_e T_s) and
// e^- = R(omega_e T_s) e. rotation = "euler": c = 1, d = omega_e T_s and e^- = e.
//
//         [1 - a       -s omega_e   -b    0   -s i_beta     ]
//         [s omega_e    1 - a        0   -b    s i_alpha    ]
//   F   = [0            0            c   -d   -T_s e_beta^- ]
//         [0            0            d    c    T_s e_alpha^-]
//         [0            0            0    0    1            ]
//   P^- = F P F' + Q
//   K   = P^- H' (H P^- H' + R)^-1
//   P   = (I - K H) P^-                              covariance = "paper"
//   P   = (I - K H) P^- (I - K H)' + K R K'          any other form
//
// The model is exact for a salient rotor; the length of e is taken to be constant over one period.
// At standstill e = 0 and holds no angle: start with "align_if". prediction = "euler" has a
// constant angle error of about omega_e T_s/2; "rk4" and "exact" have none.
// Q and R are discrete covariances of one background update: Q in A^2, A^2, V^2, V^2, (rad/s)^2; R
// in A^2, A^2. A correction that is not finite is left out: the state keeps the prediction, status
// kNotFinite.
// Source: Chen, Tomita, Doki, Okuma 2003, extended EMF; docs/theory/ipmsm-filters.md.
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
              "process noise per background update: A^2, A^2, V^2, V^2, (rad/s)^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance: A^2, A^2, V^2, V^2, (rad/s)^2");
    f.choice("rotation", rotation, kRotationNames,
             "rotation of the EMF over one period (prediction = euler)");
  }
};

class Eemf final : public Ekf<5, 2> {
 public:
  Eemf(const MachineParameters& machine, const EemfParameters& tuning, Prediction prediction,
       CovarianceForm covariance, double T_s, KnownStart start);

  std::string_view kind() const override { return "eemf"; }
  double direct_start_within() const override { return 0; }  // no EMF at standstill
  FastState start(const Measurement& first) const override;
  void align(FastState& state, double theta_e) const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override;
  int turning_pairs() const override { return 2; }  // i and e
  Estimate ahead(const Estimate& snapshot, double ticks) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;

  State f(const State& x, const Vec2& u_alphabeta) const;
  State predict(const State& x, const Vec2& u_alphabeta) const;
  Covariance jacobian(const State& x) const;  // of the Euler prediction, with its rotation

 private:
  State prior(const FastState& state, const Measurement& m) const override;
  Output innovation(const State& x_prior, const Measurement& m) const override;
  void describe(const FastState& state, const Measurement& m, Estimate& e) const override;

  MachineParameters machine_;
  Rotation rotation_;
  Prediction prediction_;
  double T_s_;
  KnownStart start_;
};

}  // namespace twinrate
