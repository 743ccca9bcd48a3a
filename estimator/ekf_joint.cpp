#include "estimator/ekf_joint.hpp"

#include <complex>

#include "estimator/exact_currents.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

template <int NX>
EkfTuning<NX, 2> tuning_of(const EkfJointParameters& p, CovarianceForm form) {
  double Q[NX], P0[NX];
  std::fill_n(Q, NX, p.Q_order);
  std::fill_n(P0, NX, p.P0_order);
  std::copy_n(p.Q_diag, 5, Q);
  std::copy_n(p.P0_diag, 5, P0);
  return {Q, p.R_diag, P0, form};
}

// With omega_e constant over the interval and L_d = L_q, i = i_alpha + j i_beta and u likewise:
//
//   L i' = -R_s i + u - j psi_f omega_e exp(j (theta_e + omega_e t))
Vec2 exact_currents(const Vec2& i_now, double omega_e, double theta_e, const Vec2& u_alphabeta,
                    const MachineParameters& m, double T_s) {
  if (m.L_d != m.L_q)
    return inverse_park(
        exact_rotor_currents(m, park(i_now, theta_e), omega_e, park(u_alphabeta, theta_e), T_s),
        theta_e + T_s * omega_e);
  using Complex = std::complex<double>;
  const Complex j(0, 1), i(i_now[0], i_now[1]), u(u_alphabeta[0], u_alphabeta[1]);
  const double a = m.R_s / m.L_q, decay = math::exp(-a * T_s);
  const Complex forced = (math::polar(1.0, omega_e * T_s) - decay) / (a + j * omega_e);
  const Complex next = decay * i + u * (1 - decay) / m.R_s -
                       j * m.psi_f / m.L_q * omega_e * math::polar(1.0, theta_e) * forced;
  return {next.real(), next.imag()};
}

}  // namespace

template <int NX>
EkfJoint<NX>::EkfJoint(const MachineParameters& machine, const EkfJointParameters& tuning,
                       Prediction prediction, CovarianceForm covariance, double T_s,
                       KnownStart start)
    : Base(tuning_of<NX>(tuning, covariance)),
      machine_(machine),
      order_(tuning.order),
      prediction_(prediction),
      T_s_(T_s),
      start_(start) {}

template <int NX>
typename EkfJoint<NX>::Drive EkfJoint<NX>::f(const Drive& x, const Vec2& u_alphabeta) const {
  const Vec2 i_dq = park(x.head<2>(), x[3]);
  const double psi_a = active_flux(i_dq[0]), T_em = machine_.torque(i_dq[0], i_dq[1]);
  const auto [s, c] = math::sincos(x[3]);
  const Vec2 d(c, s), emf = psi_a * x[2] * Vec2(-s, c);
  const Vec2 a = (u_alphabeta - machine_.R_s * x.head<2>() - emf) / machine_.L_q;
  const double z = d.dot(a) + x[2] * i_dq[1];
  Drive rate;
  rate << a + (machine_.L_q / machine_.L_d - 1) * z * d, machine_.n_p / machine_.J * (T_em - x[4]),
      x[2], 0;
  return rate;
}

template <int NX>
typename EkfJoint<NX>::Drive EkfJoint<NX>::predict_drive(const Drive& x,
                                                         const Vec2& u_alphabeta) const {
  const auto rate = [&](const Drive& s) { return f(s, u_alphabeta); };
  if (prediction_ == Prediction::kRk4) return rk4_step<Drive>(rate, x, T_s_);
  Drive next = euler_step<Drive>(rate, x, T_s_);
  if (prediction_ == Prediction::kExact)
    next.template head<2>() = exact_currents(x.head<2>(), x[2], x[3], u_alphabeta, machine_, T_s_);
  return next;
}

template <int NX>
typename EkfJoint<NX>::State EkfJoint<NX>::predict(const State& x, const Vec2& u_alphabeta) const {
  State next = x;
  Drive drive = x.template head<5>();
  if constexpr (kPair) {
    // The load of this step is the one in mid-interval.
    const Vec2 pair = x.template tail<2>();
    const double turn = turn_of_pair(x[2], 1);
    drive[4] += rotate(pair, -0.5 * turn)[0];
    next.template tail<2>() = rotate(pair, -turn);
  }
  next.template head<4>() = predict_drive(drive, u_alphabeta).template head<4>();
  return next;
}

template <int NX>
typename EkfJoint<NX>::Covariance EkfJoint<NX>::jacobian(const State& x, const Vec2& u_dq) const {
  const MachineParameters& m = machine_;
  const double omega_e = x[2], dL = m.L_d - m.L_q;
  const auto [s, c] = math::sincos(x[3]);
  const Vec2 i_dq = park(x.template head<2>(), x[3]);
  const double i_d = i_dq[0], i_q = i_dq[1], psi_a = active_flux(i_d);
  const double b = T_s_ / m.L_q, g = T_s_ * m.n_p / m.J, k = 1.5 * m.n_p;
  Covariance F = Covariance::Identity();
  F.template block<2, 2>(0, 0) *= 1 - b * m.R_s;
  F.template block<2, 2>(0, 0) += b * dL * omega_e * Vec2(s, -c) * Eigen::RowVector2d(c, s);
  F.template block<2, 1>(0, 2) = b * psi_a * Vec2(s, -c);
  F.template block<2, 1>(0, 3) = b * omega_e * (psi_a * Vec2(c, s) + dL * i_q * Vec2(s, -c));
  if (dL != 0) {
    const double kappa = m.L_q / m.L_d - 1;
    const Vec2 d(c, s), q(-s, c), a = (u_dq - m.R_s * i_dq - Vec2(0, omega_e * psi_a)) / m.L_q;
    const double z = a[0] + omega_e * i_q;
    const double z_theta = a[1] + omega_e * (psi_a / m.L_q - i_d);
    F.template block<2, 2>(0, 0) +=
        T_s_ * kappa * d * (omega_e * q - m.R_s / m.L_q * d).transpose();
    F.template block<2, 1>(0, 2) += T_s_ * kappa * i_q * d;
    F.template block<2, 1>(0, 3) += T_s_ * kappa * (z * q + z_theta * d);
  }
  F(2, 0) = g * k * (dL * c * i_q - psi_a * s);
  F(2, 1) = g * k * (dL * s * i_q + psi_a * c);
  F(2, 3) = g * k * (dL * i_q * i_q - psi_a * i_d);
  F(2, 4) = -g;
  F(3, 2) = T_s_;
  if constexpr (kPair) {
    const double turn = turn_of_pair(omega_e, 1), per_speed = turn_of_pair(1, 1);
    const Vec2 next = rotate(Vec2(x.template tail<2>()), -turn);
    F(2, 5) = -g;
    const auto [s_turn, c_turn] = math::sincos(turn);
    F.template block<2, 2>(5, 5) << c_turn, s_turn, -s_turn, c_turn;
    F.template block<2, 1>(5, 2) << per_speed * next[1], -per_speed * next[0];
  }
  return F;
}

template <int NX>
FastState EkfJoint<NX>::start(const Measurement& first) const {
  FastState state;
  state.x_hat.head<2>() = clarke(first.i_abc);
  state.x_hat[2] = start_.omega_e;
  state.x_hat[3] = wrap_turn(start_.theta_e);
  return state;
}

template <int NX>
typename EkfJoint<NX>::State EkfJoint<NX>::prior(const FastState& state,
                                                 const Measurement& m) const {
  return predict(state.x_hat.head<NX>(), m.u_alphabeta);
}

template <int NX>
typename EkfJoint<NX>::Output EkfJoint<NX>::innovation(const State& x_prior,
                                                       const Measurement& m) const {
  return clarke(m.i_abc) - x_prior.template head<2>();
}

template <int NX>
typename EkfJoint<NX>::State EkfJoint<NX>::wrapped(const State& x) const {
  State w = x;
  w[3] = wrap_turn(x[3]);
  return w;
}

// The rotor is held: the load that the filter had learnt is not the one of the forced current.
template <int NX>
void EkfJoint<NX>::align(FastState& state, double theta_e) const {
  state.x_hat.segment<NX - 2>(2).setZero();
  state.x_hat[3] = wrap_turn(theta_e);
}

template <int NX>
void EkfJoint<NX>::describe(const FastState& state, const Measurement&, Estimate& e) const {
  e.theta_e = state.x_hat[3];
  e.omega_m = state.x_hat[2] / machine_.n_p;
  e.i_dq = park(state.x_hat.head<2>(), e.theta_e);
  e.T_load = state.x_hat[4];
  if constexpr (kPair) {
    e.T_load += state.x_hat[5];
    e.dT_load_dt = order_ * e.omega_m * state.x_hat[6];
  }
}

template <int NX>
void EkfJoint<NX>::remember(FastState& state, const State& x_prior, const Measurement& m,
                            bool corrected) const {
  if (!corrected) return;
  state.x_hat.segment<2>(NX) = park(m.u_alphabeta, x_prior[3] - 0.5 * T_s_ * x_prior[2]);
}

template <int NX>
Gain EkfJoint<NX>::background_step(const Gain& previous, const Estimate& snapshot) const {
  using H = typename Base::OutputMatrix;
  const State x = snapshot.x_hat.head<NX>();
  return covariance_step(previous, snapshot, jacobian(x, snapshot.x_hat.template segment<2>(NX)),
                         H(H::Identity()), this->tuning());
}

template <int NX>
std::optional<CovarianceModel> EkfJoint<NX>::covariance_model(const Estimate& snapshot) const {
  using H = typename Base::OutputMatrix;
  const State x = snapshot.x_hat.head<NX>();
  return model_of(jacobian(x, snapshot.x_hat.template segment<2>(NX)), H(H::Identity()),
                  this->tuning());
}

template <int NX>
Estimate EkfJoint<NX>::ahead(const Estimate& snapshot, double ticks) const {
  const double angle = ticks * T_s_ * snapshot.x_hat[2];
  Estimate e = turned(snapshot, turning_pairs(), angle);
  e.x_hat[3] = e.theta_e = snapshot.x_hat[3] + angle;
  if constexpr (kPair)
    e.x_hat.segment<2>(5) =
        rotate(Vec2(snapshot.x_hat.segment<2>(5)), -turn_of_pair(snapshot.x_hat[2], ticks));
  return e;
}

template <int NX>
std::optional<Estimate> EkfJoint<NX>::steady_state(double omega_m) const {
  FastState state;
  state.x_hat[2] = machine_.n_p * omega_m;
  state.x_hat[NX + 1] = state.x_hat[2] * machine_.psi_f;  // u_q
  return this->estimate_of(state, {});
}

template <int NX>
std::optional<double> EkfJoint<NX>::load_speed_min(double u_unknown) const {
  constexpr int kSettle = 4000, kIterations = 2;  // ticks; beta hardly depends on the speed
  const MachineParameters& m = machine_;
  const double a = T_s_ * m.R_s / m.L_d, b = T_s_ / m.L_d;
  double omega_e = u_unknown / m.psi_f;
  for (int i = 0; i < kIterations; ++i) {
    const Gain gain = this->background_steps(this->initial_gain(), omega_e / m.n_p, kSettle);
    const double g_d = b / (1 - (1 - a) * (1 - gain.K(0, 0)));
    const double r = std::hypot(1.0, m.psi_f * gain.K(3, 0) * g_d / T_s_);
    omega_e = u_unknown / m.psi_f * r / (r - 1);
  }
  return omega_e;
}

template class EkfJoint<5>;
template class EkfJoint<7>;

std::shared_ptr<Filter> EkfJointKind::make(const MachineParameters& machine,
                                           const EkfJointParameters& tuning, Prediction prediction,
                                           CovarianceForm covariance, double T_s,
                                           KnownStart start) {
  if (tuning.order == 0)
    return std::make_shared<EkfJoint<5>>(machine, tuning, prediction, covariance, T_s, start);
  return std::make_shared<EkfJoint<7>>(machine, tuning, prediction, covariance, T_s, start);
}

}  // namespace twinrate
