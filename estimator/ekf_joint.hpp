// Sensorless extended Kalman filter with the load torque as a state: angle, speed and load from the
// currents alone, in the stationary frame.
//
//   state    x = [i_alpha, i_beta, omega_e, theta_e, T_0 (, a, b)]   A, A, rad/s, rad, Nm (, Nm, Nm)
//   input    u = [u_alpha, u_beta]                     V, mean applied from t_{k-1} to t_k
//   output   y = [i_alpha, i_beta]                     A;  y = H x, H = [I 0], 2 by 5 (2 by 7)
//
// a, b: one harmonic of the load, with order N > 0 (periods per mechanical turn).
//
// Model, x' = f(x, u), with d = [cos theta_e; sin theta_e], q = [-sin theta_e; cos theta_e], i_d = d'i and
// i_q = q'i the currents in rotor axes, and the active flux psi_a:
//
//   psi_a      = psi_f + (L_d - L_q) i_d
//   T_em       = 3/2 n_p psi_a i_q                                                   Niewiara (12)
//   L_q a      = u - R_s i - psi_a omega_e q                              Dilys (3), with psi_a for psi_f
//   z          = d'a + omega_e i_q
//   i'         = a + (L_q/L_d - 1) z d                 the second part: the voltage of a changing i_d
//   omega_e'   = n_p/J (T_em - T_o)                                      Dilys (1), Niewiara (12)
//   theta_e'   = omega_e                                                                Dilys (3)
//   T_o        = T_0 + a                               the load; positive opposes the motion
//   T_0'       = 0                                                                   Niewiara (20)
//   a'         =  N omega_m b                          so a = A sin(N theta_m + phase)
//   b'         = -N omega_m a                          omega_m = omega_e/n_p
//
// In rotor axes the rows of i are Niewiara (10), (11). With L_d = L_q the first four rows are those of
// estimator/ekf_sensorless.hpp. T_o holds friction, as in estimator/ekf_disturbance.hpp.
//
// Fast step, every T_s, with a given K:
//
//   x^-   = x + T_s f(x, u)            prediction = "euler"; "rk4"; "exact": the currents at frozen
//                                      omega_e. a, b are turned by R(-N omega_m T_s)
//   innov = y - H x^-
//   x     = x^- + K innov              theta_e wrapped into [0, 2 pi)              Dilys (16), (18)
//
// Background step, every n T_s, at the snapshot x, with s = sin theta_e, c = cos theta_e,
// dL = L_d - L_q, k = 3/2 n_p, g = T_s n_p/J, b_L = T_s/L, phi = N omega_m T_s, and [a^-; b^-] the
// turned pair. With L_d = L_q:
//
//   T_alpha = k (dL c i_q - psi_a s),  T_beta = k (dL s i_q + psi_a c),  T_theta = k (dL i_q^2 - psi_a i_d)
//
//   row i_alpha  [1 - T_s R_s/L + b_L dL omega_e s c,  b_L dL omega_e s^2,
//                                      b_L psi_a s,  b_L omega_e (psi_a c + dL i_q s),  0,  0,  0]
//   row i_beta   [-b_L dL omega_e c^2,  1 - T_s R_s/L - b_L dL omega_e s c,
//                                     -b_L psi_a c,  b_L omega_e (psi_a s - dL i_q c),  0,  0,  0]
//   row omega_e  [g T_alpha,  g T_beta,  1,  g T_theta,  -g,  -g,  0]
//   row theta_e  [0,  0,  T_s,  1,  0,  0,  0]
//   row T_0      [0,  0,  0,  0,  1,  0,  0]
//   row a        [0,  0,   N T_s b^-/n_p,  0,  0,   cos phi,  sin phi]
//   row b        [0,  0,  -N T_s a^-/n_p,  0,  0,  -sin phi,  cos phi]
//
// With L_d != L_q the rows of i_alpha and i_beta get, with kappa = L_q/L_d - 1:
//
//   columns i    T_s kappa d (omega_e q - R_s/L_q d)'
//   omega_e      T_s kappa i_q d
//   theta_e      T_s kappa (z q + (q'a + omega_e psi_a/L_q - omega_e i_d) d)
//
// z and a need the voltage: x_hat carries u_dq of the last period behind the state, in the rotor axes of
// its middle.
//
//   P^- = F P F' + Q                                                                   Dilys (14)
//   K   = P^- H' (H P^- H' + R)^-1                                                     Dilys (17)
//   P   = (I - K H) P^-                              covariance = "paper"              Dilys (15)
//   P   = (I - K H) P^- (I - K H)' + K R K'          any other form
//
// Every gain policy applies: (i_alpha, i_beta) turn with the rotor, the other states do not.
// `propagated` needs the form without a harmonic, which has at most 6 states.
//
// Observability: load_speed_min() below and docs/theory/joint-ekf.md. F holds the control period T_s at
// every n. Q and R are discrete covariances of one background update: Q in A^2, A^2, (rad/s)^2, rad^2,
// (Nm)^2; R in A^2, A^2. Known voltage losses are undone before the filter (estimator/known_effects.hpp);
// known torques stay part of T_o, because most depend on the mechanical angle.
// A correction that is not finite is left out: the state keeps the prediction, status kNotFinite.
// Source: Dilys 2021 and Niewiara 2020, corrected; docs/theory/joint-ekf.md.
#pragma once
#include "estimator/backemf_filter.hpp"

namespace twinrate {

struct EkfJointParameters {
  double Q_diag[5] = {1e-4, 1e-4, 1e-4, 1e-4, 1e-4};
  double R_diag[2] = {1e-3, 1e-3};
  double P0_diag[5] = {1e-2, 1e-2, 1, 1, 1};
  int order = 0;
  double Q_order = 1e-6, P0_order = 1e-2;
  void fields(FieldVisitor& f) {
    f.numbers("Q_diag", Q_diag, 0, 1e12,
              "process noise per background update: A^2, A^2, (rad/s)^2, rad^2, (Nm)^2");
    f.numbers("R_diag", R_diag, 1e-15, 1e12, "measurement noise: A^2, A^2");
    f.numbers("P0_diag", P0_diag, 0, 1e12,
              "initial covariance: A^2, A^2, (rad/s)^2, rad^2, (Nm)^2");
    f.integer("order", order, 0, 2000,
              "order of the load that is a pair of states, periods per mechanical turn; 0: none");
    f.number("Q_order_Nm2", Q_order, 0, 1e12, "process noise of both states of the pair");
    f.number("P0_order_Nm2", P0_order, 0, 1e12, "initial covariance of both states of the pair");
  }
};

// NX = 5, or 7 with a harmonic of the load.
template <int NX>
class EkfJoint final : public Ekf<NX, 2, 2> {
 public:
  using Base = Ekf<NX, 2, 2>;
  using typename Base::Covariance;
  using typename Base::Output;
  using typename Base::State;

  EkfJoint(const MachineParameters& machine, const EkfJointParameters& tuning,
           Prediction prediction, CovarianceForm covariance, double T_s, KnownStart start);

  std::string_view kind() const override { return "ekf_joint"; }
  double direct_start_within() const override { return kStartWithin; }
  // With the unknown voltage in the worst direction, against the EMF:
  //
  //   omega_e_min = u_unknown/psi_f r/(r - 1),  r = sqrt(1 + beta^2)
  //   beta        = psi_f k_theta_d g_d/T_s,    g_d = b/(1 - (1 - a)(1 - k_dd)),  a = T_s R_s/L_d, b = T_s/L_d
  //
  // k_theta_d, k_dd: the gain of theta_e and i_d on the innovation of d, in rotor axes, settled at that
  // speed without load. Derivation: docs/theory/joint-ekf.md. For beta -> infinity it is
  // u_unknown/psi_f, the speed below which the direction of the EMF, and with it the torque of the
  // currents, is unknown to any filter.
  std::optional<double> load_speed_min(double u_unknown) const override;
  FastState start(const Measurement& first) const override;
  void align(FastState& state, double theta_e) const override;
  bool estimates_load() const override { return true; }
  Gain background_step(const Gain& previous, const Estimate& snapshot) const override;
  std::optional<CovarianceModel> covariance_model(const Estimate& snapshot) const override;
  int turning_pairs() const override { return 1; }
  Estimate ahead(const Estimate& snapshot, double ticks) const override;
  std::optional<Estimate> steady_state(double omega_m) const override;

  State predict(const State& x, const Vec2& u_alphabeta) const;
  Covariance jacobian(const State& x, const Vec2& u_dq) const;

 private:
  using Drive = Eigen::Matrix<double, 5, 1>;  // the first five states
  static constexpr bool kPair = NX == 7;

  State prior(const FastState& state, const Measurement& m) const override;
  Output innovation(const State& x_prior, const Measurement& m) const override;
  State wrapped(const State& x) const override;
  // The voltage of the last period in the rotor axes of its middle.
  void remember(FastState& state, const State& x_prior, const Measurement& m,
                bool corrected) const override;
  void describe(const FastState& state, const Measurement& m, Estimate& e) const override;

  // x' of the first five states; the fifth holds the whole load.
  Drive f(const Drive& x, const Vec2& u_alphabeta) const;
  Drive predict_drive(const Drive& x, const Vec2& u_alphabeta) const;
  double active_flux(double i_d) const {
    return machine_.psi_f + (machine_.L_d - machine_.L_q) * i_d;
  }
  // Angle by which the harmonic turns in `ticks` ticks.
  double turn_of_pair(double omega_e, double ticks) const {
    return order_ * omega_e / machine_.n_p * T_s_ * ticks;
  }

  MachineParameters machine_;
  int order_;
  Prediction prediction_;
  double T_s_;
  KnownStart start_;
};

// The filter of the parameters: with `order` > 0 that of seven states.
struct EkfJointKind {
  static std::shared_ptr<Filter> make(const MachineParameters& machine,
                                      const EkfJointParameters& tuning, Prediction prediction,
                                      CovarianceForm covariance, double T_s, KnownStart start);
};

}  // namespace twinrate
