// Kalman filter of a back-EMF that turns with the rotor, in the stationary frame. It is the common
// part of backemf_printed and active_flux, which differ in the two inductances.
//
//   state    x = [i_alpha, i_beta, e_alpha, e_beta]    A, A, V, V                               (7)
//   input    u = [u_alpha, u_beta]                     V, mean applied from t_{k-1} to t_k      (9)
//   output   y = [i_alpha, i_beta]                     A;  y = H x, H = [I 0], 2 by 4     (8), (23)
//
// Model, x' = A(omega_e) x + B u:
//
//   i_alpha' = (u_alpha - R_s i_alpha - e_alpha)/L_alpha                                  (1), (4)*
//   i_beta'  = (u_beta  - R_s i_beta  - e_beta )/L_beta                                   (1), (4)*
//   e_alpha' = -omega_e e_beta                                                           (3)*, (4)*
//   e_beta'  =  omega_e e_alpha                                                          (3)*, (4)*
//
// omega_e is no state: it is the low-passed speed omega_f of estimator/emf_angle.hpp, which also
// gives the angle. Fast step, every T_s, with a given K:
//
//   x^-   = Phi x + T_s B u            prediction = "euler"; also "rk4", "exact"         (10), (20)
//   innov = y - H x^-
//   x     = x^- + K innov                                                                      (24)
//
// Background step, every n T_s, at the speed of the snapshot, with c = cos(omega_e T_s) and
// s = sin(omega_e T_s) (rotation = "exact"), or c = 1 and s = omega_e T_s (rotation = "euler"):
//
//         [1 - T_s R_s/L_alpha   0                    -T_s/L_alpha   0          ]
//   Phi = [0                     1 - T_s R_s/L_beta    0            -T_s/L_beta ]             (22)*
//         [0                     0                     c            -s          ]
//         [0                     0                     s             c          ]
//   P^- = Phi P Phi' + Q_0                                                                    (25)*
//   K   = P^- H' (H P^- H' + R_0)^-1                                                           (27)
//   P   = (I - K H) P^-                              covariance = "paper"                      (26)
//   P   = (I - K H) P^- (I - K H)' + K R_0 K'        any other form
//
// Q_0 and R_0 are discrete covariances of one background update: Q_0 in A^2, A^2, V^2, V^2; R_0 in
// A^2, A^2. A correction that is not finite is left out: the state keeps the prediction, status
// kNotFinite.
// The paper's axes: i_q^s = i_alpha, i_d^s = -i_beta, E_q^s = e_alpha, E_d^s = -e_beta.
// Source: Kim, Yoon, Kook. An asterisk marks an equation whose printed form is wrong
// (docs/theory/ipmsm-filters.md).
#pragma once
#include "estimator/ekf.hpp"
#include "model/discretise.hpp"
#include "model/machine.hpp"

namespace twinrate {

enum class Rotation : int { kExact = 0, kEuler = 1 };
inline constexpr const char* kRotationNames[] = {"exact", "euler"};

struct BackEmfParameters {
  double Q_diag[4] = {2e3, 2e3, 80e3, 10e3};
  double R_diag[2] = {0.5, 0.5};
  double P0_diag[4] = {0.1, 0.1, 200, 10};
  Rotation rotation = Rotation::kExact;
  EmfAngleParameters angle;
  void fields(FieldVisitor& f) {
    f.numbers("Q_diag", Q_diag, 0, 1e12, "process noise per background update: A^2, A^2, V^2, V^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12, "initial covariance: A^2, A^2, V^2, V^2");
    f.choice("rotation", rotation, kRotationNames, "rotation of the EMF over one period");
    angle.fields(f);
  }
};

// Angle and speed of the rotor at the start if they are known (flying start), else 0.
struct KnownStart {
  double theta_e = 0, omega_e = 0;
};

class BackEmfFilter : public Ekf<4, 2> {
 public:
  // L = [L_alpha, L_beta].
  BackEmfFilter(const MachineParameters& machine, const Vec2& L, const BackEmfParameters& tuning,
                Prediction prediction, CovarianceForm covariance, double T_s, KnownStart start);

  FastState start(const Measurement& first) const override;
  void align(FastState& state, double theta_e) const override;
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override;
  // None turns: Phi, H, Q and R are constant in the stationary frame at constant speed, and so is
  // the gain, for any two inductances and noises.
  int turning_pairs() const override { return 0; }
  Estimate ahead(const Estimate& snapshot, double ticks) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;

  State predict(const State& x, const Vec2& u_alphabeta, double omega_e) const;
  Covariance transition(double omega_e) const;  // Phi

 private:
  State prior(const FastState& state, const Measurement& m) const override;
  Output innovation(const State& x_prior, const Measurement& m) const override;
  void describe(const FastState& state, const Measurement& m, Estimate& e) const override;
  // Angle and speed, one tick of estimator/emf_angle.hpp.
  void remember(FastState& state, const State& x_prior, const Measurement& m,
                bool corrected) const override;
  Eigen::Matrix4d A(double omega_e) const;

  MachineParameters machine_;
  Vec2 L_;
  Rotation rotation_;
  EmfAngleParameters angle_;
  Prediction prediction_;
  double T_s_;
  KnownStart start_;
};

}  // namespace twinrate
