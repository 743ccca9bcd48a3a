#include "estimator/dq_ekf.hpp"

#include "estimator/exact_currents.hpp"

namespace twinrate {

DqEkf::DqEkf(const MachineParameters& machine, const DqEkfParameters& tuning, Prediction prediction,
             CovarianceForm covariance, double T_s, KnownStart start)
    : Ekf({tuning.Q_diag, {tuning.r, tuning.r}, tuning.P0_diag, covariance}),
      machine_(machine),
      prediction_(prediction),
      T_s_(T_s),
      start_(start) {}

DqEkf::State DqEkf::f(const State& x, const Vec2& u_alphabeta) const {
  const MachineParameters& m = machine_;
  const double i_d = x[0], i_q = x[1], omega_e = x[2];
  const Vec2 u_dq = park(u_alphabeta, x[3]);
  return {(u_dq[0] - m.R_s * i_d + omega_e * m.L_q * i_q) / m.L_d,
          (u_dq[1] - m.R_s * i_q - omega_e * (m.L_d * i_d + m.psi_f)) / m.L_q, 0.0, omega_e};
}

DqEkf::State DqEkf::predict(const State& x, const Vec2& u_alphabeta) const {
  const auto rate = [&](const State& s) { return f(s, u_alphabeta); };
  switch (prediction_) {
    case Prediction::kEuler:
      return euler_step<State>(rate, x, T_s_);
    case Prediction::kRk4:
      return rk4_step<State>(rate, x, T_s_);
    case Prediction::kExact: {
      const Vec2 i_dq =
          exact_rotor_currents(machine_, x.head<2>(), x[2], park(u_alphabeta, x[3]), T_s_);
      return {i_dq[0], i_dq[1], x[2], x[3] + T_s_ * x[2]};
    }
  }
  return x;
}

DqEkf::Covariance DqEkf::jacobian(const State& x, const Vec2& u_dq) const {
  const MachineParameters& m = machine_;
  const double omega_e = x[2];
  Eigen::Matrix4d F_c = Eigen::Matrix4d::Zero();
  F_c.row(0) << -m.R_s / m.L_d, omega_e * m.L_q / m.L_d, m.L_q * x[1] / m.L_d, u_dq[1] / m.L_d;
  F_c.row(1) << -omega_e * m.L_d / m.L_q, -m.R_s / m.L_q, -(m.L_d * x[0] + m.psi_f) / m.L_q,
      -u_dq[0] / m.L_q;
  F_c(3, 2) = 1;
  return Eigen::Matrix4d::Identity() + T_s_ * F_c;
}

DqEkf::OutputMatrix DqEkf::output_jacobian(const State& x) {
  OutputMatrix H;
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

DqEkf::State DqEkf::prior(const FastState& state, const Measurement& m) const {
  return predict(state.x_hat.head<4>(), m.u_alphabeta);
}

DqEkf::Output DqEkf::innovation(const State& x_prior, const Measurement& m) const {
  return park(clarke(m.i_abc), x_prior[3]) - x_prior.head<2>();
}

DqEkf::State DqEkf::wrapped(const State& x) const {
  return {x[0], x[1], x[2], wrap_turn(x[3])};
}

void DqEkf::remember(FastState& state, const State& x_prior, const Measurement& m,
                     bool corrected) const {
  if (!corrected) return;
  state.x_hat.segment<2>(4) = park(m.u_alphabeta, x_prior[3] - 0.5 * T_s_ * x_prior[2]);
}

void DqEkf::align(FastState& state, double theta_e) const {
  // The same current vector, in the axes of a rotor at that angle.
  state.x_hat.head<2>() = rotate(state.x_hat.head<2>(), state.x_hat[3] - theta_e);
  state.x_hat[2] = 0;
  state.x_hat[3] = wrap_turn(theta_e);
}

void DqEkf::describe(const FastState& state, const Measurement&, Estimate& e) const {
  e.theta_e = state.x_hat[3];
  e.omega_m = state.x_hat[2] / machine_.n_p;
  e.i_dq = state.x_hat.head<2>();
}

Gain DqEkf::background_step(const Gain& previous, const Estimate& snapshot) const {
  const auto [F, H] = linearised(snapshot);
  return covariance_step(previous, snapshot, F, H, tuning());
}

std::optional<CovarianceModel> DqEkf::covariance_model(const Estimate& snapshot) const {
  const auto [F, H] = linearised(snapshot);
  return model_of(F, H, tuning());
}

std::pair<DqEkf::Covariance, DqEkf::OutputMatrix> DqEkf::linearised(
    const Estimate& snapshot) const {
  const State x = snapshot.x_hat.head<4>();
  const Vec2 u_dq = snapshot.x_hat.segment<2>(4);
  // The voltage of the next period is not known yet: in rotor axes it is taken to be constant.
  const State x_prior = predict(x, inverse_park(u_dq, x[3] + 0.5 * T_s_ * x[2]));
  return {jacobian(x, u_dq), output_jacobian(x_prior)};
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
  return estimate_of(state, {});
}

}  // namespace twinrate
