#include "estimator/dq_ekf.hpp"

#include "model/discretise_exact.hpp"

namespace twinrate {

DqEkf::DqEkf(const MachineParameters& machine, const DqEkfParameters& tuning, Prediction prediction,
             CovarianceForm covariance, double T_s, KnownStart start)
    : machine_(machine),
      tuning_(tuning),
      prediction_(prediction),
      covariance_(covariance),
      T_s_(T_s),
      start_(start) {}

DqEkf::State DqEkf::f(const State& x, const Vec2& u_alphabeta) const {
  const MachineParameters& m = machine_;
  const double i_d = x[0], i_q = x[1], omega_e = x[2];
  const Vec2 u_dq = park(u_alphabeta, x[3]);
  return {(u_dq[0] - m.R_s * i_d + omega_e * m.L_q * i_q) / m.L_d,
          (u_dq[1] - m.R_s * i_q - omega_e * (m.L_d * i_d + m.psi_f)) / m.L_q, 0.0, omega_e};
}

// With omega_e constant the currents are linear, and the voltage turns backwards in rotor axes:
// [i_dq; u_dq]' = A [i_dq; u_dq] + B omega_e psi_f.
static Vec2 exact_currents(const MachineParameters& m, const DqEkf::State& x,
                           const Vec2& u_alphabeta, double T_s) {
  const double omega_e = x[2];
  Eigen::Matrix4d A;
  A << -m.R_s / m.L_d, omega_e * m.L_q / m.L_d, 1 / m.L_d, 0,  //
      -omega_e * m.L_d / m.L_q, -m.R_s / m.L_q, 0, 1 / m.L_q,  //
      0, 0, 0, omega_e,                                        //
      0, 0, -omega_e, 0;
  const Eigen::Vector4d B(0, -1 / m.L_q, 0, 0);
  const auto d = discretise_exact<4, 1>(A, B, T_s);
  Eigen::Vector4d z;
  z << x.head<2>(), park(u_alphabeta, x[3]);
  const Eigen::Vector4d next = d.A * z + d.B * (omega_e * m.psi_f);
  return next.head<2>();
}

DqEkf::State DqEkf::predict(const State& x, const Vec2& u_alphabeta) const {
  const auto rate = [&](const State& s) { return f(s, u_alphabeta); };
  switch (prediction_) {
    case Prediction::kEuler:
      return euler_step<State>(rate, x, T_s_);
    case Prediction::kRk4:
      return rk4_step<State>(rate, x, T_s_);
    case Prediction::kExact: {
      const Vec2 i_dq = exact_currents(machine_, x, u_alphabeta, T_s_);
      return {i_dq[0], i_dq[1], x[2], x[3] + T_s_ * x[2]};
    }
  }
  return x;
}

Eigen::Matrix4d DqEkf::jacobian(const State& x, const Vec2& u_dq) const {
  const MachineParameters& m = machine_;
  const double omega_e = x[2];
  Eigen::Matrix4d F_c = Eigen::Matrix4d::Zero();
  F_c.row(0) << -m.R_s / m.L_d, omega_e * m.L_q / m.L_d, m.L_q * x[1] / m.L_d, u_dq[1] / m.L_d;
  F_c.row(1) << -omega_e * m.L_d / m.L_q, -m.R_s / m.L_q, -(m.L_d * x[0] + m.psi_f) / m.L_q,
      -u_dq[0] / m.L_q;
  F_c(3, 2) = 1;
  return Eigen::Matrix4d::Identity() + T_s_ * F_c;
}

Eigen::Matrix<double, 2, 4> DqEkf::output_jacobian(const State& x) {
  Eigen::Matrix<double, 2, 4> H;
  H << 1, 0, 0, -x[1],  //
      0, 1, 0, x[0];
  return H;
}

FastState DqEkf::start(const Measurement& first) const {
  FastState state;
  state.x_hat.head<2>() = park(clarke(first.i_abc), start_.theta_e);
  state.x_hat[2] = start_.omega_e;
  state.x_hat[3] = wrap_turn(start_.theta_e);
  return state;
}

// The voltage of the last period in the rotor axes of its middle.
static Vec2 voltage_in_rotor_axes(const Vec2& u_alphabeta, double theta_e_prior, double omega_e,
                                  double T_s) {
  return park(u_alphabeta, theta_e_prior - 0.5 * T_s * omega_e);
}

Correction DqEkf::fast_step(FastState& state, const Measurement& m, const Gain& gain) const {
  const State x_prior = predict(state.x_hat.head<4>(), m.u_alphabeta);
  const Vec2 innov = park(clarke(m.i_abc), x_prior[3]) - x_prior.head<2>();
  State x = x_prior + gain.K.topLeftCorner<4, 2>() * innov;
  Correction correction;
  if (!x.allFinite()) {
    predict_over_gap(state, m);
    correction.status = kNotFinite;
    return correction;
  }
  x[3] = wrap_turn(x[3]);
  state.x_hat.head<4>() = x;
  state.x_hat.segment<2>(4) = voltage_in_rotor_axes(m.u_alphabeta, x_prior[3], x_prior[2], T_s_);
  correction.innov.head<2>() = innov;
  return correction;
}

void DqEkf::predict_over_gap(FastState& state, const Measurement& last) const {
  State x = predict(state.x_hat.head<4>(), last.u_alphabeta);
  if (!x.allFinite()) return;
  x[3] = wrap_turn(x[3]);
  state.x_hat.head<4>() = x;
}

void DqEkf::align(FastState& state, double theta_e) const {
  // The same current vector, seen from the rotor that stands there.
  state.x_hat.head<2>() = rotate(state.x_hat.head<2>(), state.x_hat[3] - theta_e);
  state.x_hat[2] = 0;
  state.x_hat[3] = wrap_turn(theta_e);
}

Estimate DqEkf::output(const FastState& state, const Measurement&) const {
  Estimate e;
  e.n_x = 6;  // the state, and the voltage that the background needs: both travel
  e.n_y = 2;
  e.theta_e = state.x_hat[3];
  e.omega_m = state.x_hat[2] / machine_.n_p;
  e.i_dq = state.x_hat.head<2>();
  return e;
}

Gain DqEkf::initial_gain() const {
  Gain gain;
  gain.n_x = 4;
  gain.n_y = 2;
  gain.P.topLeftCorner<4, 4>() = Eigen::Map<const State>(tuning_.P0_diag).asDiagonal();
  return gain;
}

Gain DqEkf::background_step(const Gain& previous, const Estimate& snapshot) const {
  const State x = snapshot.x_hat.head<4>();
  const Vec2 u_dq = snapshot.x_hat.segment<2>(4);
  const Eigen::Matrix4d F = jacobian(x, u_dq);
  const Eigen::Matrix4d Q = Eigen::Map<const State>(tuning_.Q_diag).asDiagonal();
  const Eigen::Matrix4d P_prior = F * previous.P.topLeftCorner<4, 4>() * F.transpose() + Q;
  // The voltage of the next period is not known yet: in rotor axes it is taken to stay.
  const State x_prior = predict(x, inverse_park(u_dq, x[3] + 0.5 * T_s_ * x[2]));
  const Eigen::Matrix2d R = tuning_.r * Eigen::Matrix2d::Identity();
  return gain_from_prior<4, 2>(previous, snapshot, P_prior, output_jacobian(x_prior), R,
                               covariance_ != CovarianceForm::kPaper);
}

Estimate DqEkf::ahead(const Estimate& snapshot, double ticks) const {
  Estimate e = snapshot;
  e.x_hat[3] = e.theta_e = snapshot.x_hat[3] + ticks * T_s_ * snapshot.x_hat[2];
  return e;
}

std::optional<Estimate> DqEkf::steady_state(double omega_m) const {
  FastState state;
  state.x_hat[2] = machine_.n_p * omega_m;
  state.x_hat[5] = state.x_hat[2] * machine_.psi_f;  // u_q
  Estimate e = output(state, {});
  e.x_hat = state.x_hat;
  return e;
}

}  // namespace twinrate
