#include "estimator/eemf.hpp"

#include "model/discretise_exact.hpp"
#include "model/math.hpp"

namespace twinrate {

Eemf::Eemf(const MachineParameters& machine, const EemfParameters& tuning, Prediction prediction,
           CovarianceForm covariance, double T_s, KnownStart start)
    : Ekf({tuning.Q_diag, tuning.R_diag, tuning.P0_diag, covariance}),
      machine_(machine),
      rotation_(tuning.rotation),
      prediction_(prediction),
      T_s_(T_s),
      start_(start) {}

Eemf::State Eemf::f(const State& x, const Vec2& u_alphabeta) const {
  const double R_s = machine_.R_s, L_d = machine_.L_d, coupling = x[4] * (L_d - machine_.L_q);
  State rate;
  rate << (u_alphabeta[0] - R_s * x[0] - coupling * x[1] - x[2]) / L_d,
      (u_alphabeta[1] - R_s * x[1] + coupling * x[0] - x[3]) / L_d,  //
      -x[4] * x[3], x[4] * x[2], 0;
  return rate;
}

// Linear once omega_e is frozen.
static Vec2 exact_part(const MachineParameters& m, const Eemf::State& x, const Vec2& u_alphabeta,
                       double T_s, Vec2& e_next) {
  const double omega_e = x[4], coupling = omega_e * (m.L_d - m.L_q) / m.L_d;
  Eigen::Matrix4d A;
  A << -m.R_s / m.L_d, -coupling, -1 / m.L_d, 0,  //
      coupling, -m.R_s / m.L_d, 0, -1 / m.L_d,    //
      0, 0, 0, -omega_e,                          //
      0, 0, omega_e, 0;
  Eigen::Matrix<double, 4, 2> B = Eigen::Matrix<double, 4, 2>::Zero();
  B(0, 0) = B(1, 1) = 1 / m.L_d;
  const auto d = discretise_exact<4, 2>(A, B, T_s);
  const Eigen::Vector4d next = d.A * x.head<4>() + d.B * u_alphabeta;
  e_next = next.tail<2>();
  return next.head<2>();
}

Eemf::State Eemf::predict(const State& x, const Vec2& u_alphabeta) const {
  const auto rate = [&](const State& s) { return f(s, u_alphabeta); };
  switch (prediction_) {
    case Prediction::kEuler: {
      State next = euler_step<State>(rate, x, T_s_);
      if (rotation_ == Rotation::kExact) next.segment<2>(2) = rotate(x.segment<2>(2), x[4] * T_s_);
      return next;
    }
    case Prediction::kRk4:
      return rk4_step<State>(rate, x, T_s_);
    case Prediction::kExact: {
      State next = x;
      Vec2 e_next;
      next.head<2>() = exact_part(machine_, x, u_alphabeta, T_s_, e_next);
      next.segment<2>(2) = e_next;
      return next;
    }
  }
  return x;
}

Eemf::Covariance Eemf::jacobian(const State& x) const {
  const double a = T_s_ * machine_.R_s / machine_.L_d, b = T_s_ / machine_.L_d;
  const double s = T_s_ * (machine_.L_d - machine_.L_q) / machine_.L_d, omega_e = x[4];
  Covariance F = Covariance::Identity();
  F.row(0) << 1 - a, -s * omega_e, -b, 0, -s * x[1];
  F.row(1) << s * omega_e, 1 - a, 0, -b, s * x[0];
  if (rotation_ == Rotation::kExact) {
    const auto [sine, cosine] = math::sincos(omega_e * T_s_);
    const Vec2 e = rotate(x.segment<2>(2), omega_e * T_s_);
    F.row(2) << 0, 0, cosine, -sine, -T_s_ * e[1];
    F.row(3) << 0, 0, sine, cosine, T_s_ * e[0];
  } else {
    F.row(2) << 0, 0, 1, -omega_e * T_s_, -T_s_ * x[3];
    F.row(3) << 0, 0, omega_e * T_s_, 1, T_s_ * x[2];
  }
  return F;
}

FastState Eemf::start(const Measurement& first) const {
  FastState state;
  state.x_hat.head<2>() = clarke(first.i_abc);
  state.x_hat.segment<2>(2) = inverse_park({0, start_.omega_e * machine_.psi_f}, start_.theta_e);
  state.x_hat[4] = start_.omega_e;
  return state;
}

Eemf::State Eemf::prior(const FastState& state, const Measurement& m) const {
  return predict(state.x_hat.head<5>(), m.u_alphabeta);
}

Eemf::Output Eemf::innovation(const State& x_prior, const Measurement& m) const {
  return clarke(m.i_abc) - x_prior.head<2>();
}

void Eemf::align(FastState& state, double) const {
  state.x_hat.segment<3>(2).setZero();
}

void Eemf::describe(const FastState& state, const Measurement&, Estimate& e) const {
  const Vec2 e_ex = state.x_hat.segment<2>(2);
  const double direction = state.x_hat[4] < 0 ? -1 : 1;
  e.theta_e = wrap_turn(math::atan2(-direction * e_ex[0], direction * e_ex[1]));
  e.omega_m = state.x_hat[4] / machine_.n_p;
  e.i_dq = park(state.x_hat.head<2>(), e.theta_e);
}

Gain Eemf::background_step(const Gain& previous, const Estimate& snapshot) const {
  const Covariance F = jacobian(snapshot.x_hat.head<5>());
  const OutputMatrix H = OutputMatrix::Identity();
  return covariance_step(previous, snapshot, F, H, tuning());
}

std::optional<CovarianceModel> Eemf::covariance_model(const Estimate& snapshot) const {
  return model_of(jacobian(snapshot.x_hat.head<5>()), OutputMatrix(OutputMatrix::Identity()),
                  tuning());
}

Estimate Eemf::ahead(const Estimate& snapshot, double ticks) const {
  return turned(snapshot, turning_pairs(), ticks * T_s_ * snapshot.x_hat[4]);
}

std::optional<Estimate> Eemf::steady_state(double omega_m) const {
  FastState state;
  state.x_hat[4] = machine_.n_p * omega_m;
  state.x_hat[3] = state.x_hat[4] * machine_.psi_f;
  return estimate_of(state, {});
}

}  // namespace twinrate
