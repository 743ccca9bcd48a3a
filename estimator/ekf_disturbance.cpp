#include "estimator/ekf_disturbance.hpp"

#include "estimator/kernels/ekf_dq_kernel.hpp"
#include "model/discretise_exact.hpp"
#include "model/point_of.hpp"

namespace twinrate {

EkfDisturbance::EkfDisturbance(const MachineParameters& machine,
                               const EkfDisturbanceParameters& tuning, Prediction prediction,
                               CovarianceForm covariance, double T_s)
    : machine_(machine),
      full_(tuning.Q_diag, tuning.R_diag, tuning.P0_diag,
            resolve(covariance, tuning.Q_diag, tuning.R_diag, tuning.P0_diag)),
      reduced_({tuning.Q_diag[2], tuning.Q_diag[3]}, {tuning.R_diag[2]},
               {tuning.P0_diag[2], tuning.P0_diag[3]}, full_.form),
      L_(tuning.L),
      speed_from_angle_(tuning.speed_from_angle),
      prediction_(prediction),
      T_s_(T_s) {}

EkfDisturbance::State EkfDisturbance::f(const State& x, const Vec2& u_dq) const {
  const double R_s = machine_.R_s, L_d = machine_.L_d, L_q = machine_.L_q, psi_f = machine_.psi_f;
  const double i_d = x[0], i_q = x[1], omega_e = machine_.n_p * x[2], T_o = x[3];
  return {(u_dq[0] - R_s * i_d + omega_e * L_q * i_q) / L_d,
          (u_dq[1] - R_s * i_q - omega_e * (L_d * i_d + psi_f)) / L_q,
          (machine_.torque(i_d, i_q) - T_o) / machine_.J, 0.0};
}

EkfDisturbance::State EkfDisturbance::predict(const State& x, const Vec2& u_dq) const {
  const auto rate = [&](const State& s) { return f(s, u_dq); };
  switch (prediction_) {
    case Prediction::kEuler:
      return euler_step<State>(rate, x, T_s_);
    case Prediction::kRk4:
      return rk4_step<State>(rate, x, T_s_);
    case Prediction::kExact: {  // linear once omega_m (and i_d in the reluctance torque) is frozen
      const double omega_e = machine_.n_p * x[2];
      Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
      A(0, 0) = -machine_.R_s / machine_.L_d;
      A(0, 1) = omega_e * machine_.L_q / machine_.L_d;
      A(1, 0) = -omega_e * machine_.L_d / machine_.L_q;
      A(1, 1) = -machine_.R_s / machine_.L_q;
      A(1, 2) = -machine_.n_p * machine_.psi_f / machine_.L_q;
      A(2, 1) = machine_.torque(x[0], 1.0) / machine_.J;
      A(2, 3) = -1 / machine_.J;
      Eigen::Matrix<double, 4, 2> B = Eigen::Matrix<double, 4, 2>::Zero();
      B(0, 0) = 1 / machine_.L_d;
      B(1, 1) = 1 / machine_.L_q;
      const auto d = discretise_exact<4, 2>(A, B, T_s_);
      return d.A * x + d.B * u_dq;
    }
  }
  return x;
}

Eigen::Matrix4d EkfDisturbance::jacobian(const State& x) const {
  const double L_d = machine_.L_d, L_q = machine_.L_q, R_s = machine_.R_s;
  const double n_p = machine_.n_p, omega_e = n_p * x[2], dL = L_d - L_q;
  Eigen::Matrix4d F_c = Eigen::Matrix4d::Zero();
  F_c.row(0) << -R_s / L_d, omega_e * L_q / L_d, n_p * x[1] * L_q / L_d, 0;
  F_c.row(1) << -omega_e * L_d / L_q, -R_s / L_q, -n_p * (L_d * x[0] + machine_.psi_f) / L_q, 0;
  F_c.row(2) << 1.5 * n_p * dL * x[1] / machine_.J, machine_.torque(x[0], 1.0) / machine_.J, 0,
      -1 / machine_.J;
  return Eigen::Matrix4d::Identity() + T_s_ * F_c;
}

Vec2 EkfDisturbance::currents(const Measurement& m) const {
  return park(clarke(m.i_abc), machine_.n_p * m.theta_m);
}

double EkfDisturbance::measured_speed(const FastState& state, const Measurement& m) const {
  return speed_from_angle_ ? (m.theta_m - state.theta_m_prev) / T_s_ : m.omega_m;
}

OperatingPoint EkfDisturbance::point(const Vec2& i_dq, double omega_m, double theta_m,
                                     std::int64_t t_ns) const {
  return point_of(1e-9 * static_cast<double>(t_ns), frame_at(theta_m, omega_m, machine_.n_p), i_dq);
}

// T_o of the state is the load without its known part.
EkfDisturbance::State EkfDisturbance::predict_known(const State& x, const Vec2& u_dq,
                                                    double theta_m, std::int64_t t_ns) const {
  const double T_known = known().torque(point(x.head<2>(), x[2], theta_m, t_ns));
  State next = predict({x[0], x[1], x[2], x[3] + T_known}, u_dq);
  next[3] = x[3];
  return next;
}

static bool has_voltage(const Measurement& m) {
  return (m.signals & kVoltage) != 0;
}

FastState EkfDisturbance::start(const Measurement& first) const {
  FastState state;
  state.reduced = !has_voltage(first);
  state.theta_m_prev = first.theta_m;
  state.i_dq_prev = currents(first);
  const double omega_m = speed_from_angle_ ? 0 : first.omega_m;
  if (has_voltage(first))
    state.x_hat.head<3>() << state.i_dq_prev, omega_m;
  else
    state.x_hat[0] = omega_m;
  return state;
}

Correction EkfDisturbance::fast_step(FastState& state, const Measurement& m,
                                     const Gain& gain) const {
  if (state.reduced == has_voltage(m)) {  // voltages came or went: the other form starts
    state = start(m);
    return {};
  }
  const Correction correction =
      has_voltage(m) ? full_step(state, m, gain) : reduced_step(state, m, gain);
  state.theta_m_prev = m.theta_m;
  state.i_dq_prev = currents(m);
  return correction;
}

Correction EkfDisturbance::full_step(FastState& state, const Measurement& m,
                                     const Gain& gain) const {
  const double theta_e_mid = 0.5 * machine_.n_p * (state.theta_m_prev + m.theta_m);
  Eigen::Vector3d y;
  y << currents(m), measured_speed(state, m);
  const State x_predicted = predict_known(state.x_hat.head<4>(), park(m.u_alphabeta, theta_e_mid),
                                          theta_e_mid / machine_.n_p, m.t_ns);
  State x_prior = x_predicted;
  x_prior[3] += L_ * T_s_ * (y[2] - x_prior[2]);
  const Eigen::Vector3d innov = y - x_prior.head<3>();
  State x = x_prior;  // a gain of the other form is no gain
  if (gain.n_x == 4) x += gain.K.topLeftCorner<4, 3>() * innov;
  return take_over(state, x, x_predicted, innov);
}

Correction EkfDisturbance::reduced_step(FastState& state, const Measurement& m,
                                        const Gain& gain) const {
  const Vec2 i_dq = 0.5 * (currents(m) + state.i_dq_prev);
  const double T_known =
      known().torque(point(i_dq, state.x_hat[0], 0.5 * (state.theta_m_prev + m.theta_m), m.t_ns));
  const double omega_prior =
      state.x_hat[0] +
      T_s_ / machine_.J * (machine_.torque(i_dq[0], i_dq[1]) - state.x_hat[1] - T_known);
  const Vec2 x_predicted(omega_prior, state.x_hat[1]);
  const Eigen::Matrix<double, 1, 1> innov(measured_speed(state, m) - omega_prior);
  Vec2 x(omega_prior, state.x_hat[1] + L_ * T_s_ * innov[0]);
  if (gain.n_x == 2) x += gain.K.topLeftCorner<2, 1>() * innov;
  return take_over(state, x, x_predicted, innov);
}

void EkfDisturbance::predict_over_gap(FastState& state, const Measurement& last) const {
  if (has_voltage(last)) {
    const double theta_e_mid = machine_.n_p * (state.theta_m_prev + 0.5 * T_s_ * state.x_hat[2]);
    const State x = predict_known(state.x_hat.head<4>(), park(last.u_alphabeta, theta_e_mid),
                                  theta_e_mid / machine_.n_p, last.t_ns);
    state.theta_m_prev += T_s_ * state.x_hat[2];
    if (x.allFinite()) state.x_hat.head<4>() = x;
  } else {
    const double T_em = machine_.torque(state.i_dq_prev[0], state.i_dq_prev[1]);
    state.theta_m_prev += T_s_ * state.x_hat[0];
    state.x_hat[0] += T_s_ / machine_.J * (T_em - state.x_hat[1]);
  }
}

Estimate EkfDisturbance::output(const FastState& state, const Measurement& m) const {
  Estimate e;
  e.status = kMeasuredAngle;
  e.theta_e = wrap_turn(machine_.n_p * m.theta_m);
  if (has_voltage(m)) {
    e.n_x = 4;
    e.n_y = 3;
    e.i_dq = state.x_hat.head<2>();
    e.omega_m = state.x_hat[2];
    e.T_load = state.x_hat[3];
  } else {
    e.n_x = 2;
    e.n_y = 1;
    e.status |= kNoVoltage;
    e.i_dq = state.i_dq_prev;
    e.omega_m = state.x_hat[0];
    e.T_load = state.x_hat[1];
  }
  // The known part, and its rate along the turn.
  const auto known_load = [&](double theta_m) {
    return known().load(point(e.i_dq, e.omega_m, theta_m, m.t_ns));
  };
  const double T_known = known_load(m.theta_m);
  e.T_load += T_known;
  e.dT_load_dt = (known_load(m.theta_m + T_s_ * e.omega_m) - T_known) / T_s_;
  return e;
}

Gain EkfDisturbance::initial_gain() const {
  return first_gain(full_.P0_diag, 3);
}

Gain EkfDisturbance::initial_gain_without_voltage() const {
  return first_gain(reduced_.P0_diag, 1);
}

Gain EkfDisturbance::sequential_step(const Gain& previous, const Estimate& snapshot) const {
  const MachineParameters& m = machine_;
  const auto c = kernel::dq_constants<double>(m.R_s, m.L_d, m.L_q, m.psi_f, m.J, m.n_p, 0, T_s_);
  const auto& x = snapshot.x_hat;
  const Eigen::Matrix4d P = covariance_before(previous, full_);
  const kernel::Symmetric4<double> p{P(0, 0), P(0, 1), P(0, 2), P(0, 3), P(1, 1),
                                     P(1, 2), P(1, 3), P(2, 2), P(2, 3), P(3, 3)};
  const auto [K, p_new] = kernel::sequential(
      propagate(c, kernel::DqState<double>{x[0], x[1], x[2], x[3]}, p, full_.Q_diag), full_.R_diag);
  Eigen::Matrix<double, 4, 3> K_new;
  K_new << K.k00, K.k01, K.k02, K.k10, K.k11, K.k12, K.k20, K.k21, K.k22, K.k30, K.k31, K.k32;
  Eigen::Matrix4d P_new;
  P_new << p_new.m00, p_new.m01, p_new.m02, p_new.m03,  //
      p_new.m01, p_new.m11, p_new.m12, p_new.m13,       //
      p_new.m02, p_new.m12, p_new.m22, p_new.m23,       //
      p_new.m03, p_new.m13, p_new.m23, p_new.m33;
  return gain_of_snapshot(previous, snapshot, K_new, P_new);
}

Gain EkfDisturbance::background_step(const Gain& previous, const Estimate& snapshot) const {
  if (snapshot.n_x == 2) {  // the [omega_m, T_o] block alone
    Eigen::Matrix2d F = Eigen::Matrix2d::Identity();
    F(0, 1) = -T_s_ / machine_.J;
    return covariance_step(previous, snapshot, F, {1, 0}, reduced_);
  }
  if (full_.form == CovarianceForm::kSequential) return sequential_step(previous, snapshot);
  const Eigen::Matrix4d F = jacobian(snapshot.x_hat.head<4>());
  const Eigen::Matrix<double, 3, 4> C = Eigen::Matrix<double, 3, 4>::Identity();
  return covariance_step(previous, snapshot, F, C, full_);
}

std::optional<CovarianceModel> EkfDisturbance::covariance_model(const Estimate& snapshot) const {
  if (snapshot.n_x != 4) return {};
  using OutputMatrix = Eigen::Matrix<double, 3, 4>;
  return model_of(jacobian(snapshot.x_hat.head<4>()), OutputMatrix(OutputMatrix::Identity()),
                  full_);
}

std::optional<Estimate> EkfDisturbance::steady_state(double omega_m) const {
  FastState state;
  state.x_hat[2] = omega_m;
  return estimate_of(state, {.signals = kVoltage});
}

}  // namespace twinrate
