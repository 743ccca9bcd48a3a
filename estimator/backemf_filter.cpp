#include "estimator/backemf_filter.hpp"

#include "model/discretise_exact.hpp"

namespace twinrate {

BackEmfFilter::BackEmfFilter(const MachineParameters& machine, const Vec2& L,
                             const BackEmfParameters& tuning, Prediction prediction,
                             CovarianceForm covariance, double T_s, KnownStart start)
    : machine_(machine),
      L_(L),
      tuning_(tuning),
      prediction_(prediction),
      covariance_(covariance),
      T_s_(T_s),
      start_(start) {}

Eigen::Matrix4d BackEmfFilter::A(double omega_e) const {
  Eigen::Matrix4d A;
  A << -machine_.R_s / L_[0], 0, -1 / L_[0], 0,  //
      0, -machine_.R_s / L_[1], 0, -1 / L_[1],   //
      0, 0, 0, -omega_e,                         //
      0, 0, omega_e, 0;
  return A;
}

Eigen::Matrix4d BackEmfFilter::transition(double omega_e) const {
  Eigen::Matrix4d Phi = Eigen::Matrix4d::Identity() + T_s_ * A(omega_e);
  if (tuning_.rotation == Rotation::kExact) {
    const double c = std::cos(omega_e * T_s_), s = std::sin(omega_e * T_s_);
    Phi.bottomRightCorner<2, 2>() << c, -s, s, c;
  }
  return Phi;
}

BackEmfFilter::State BackEmfFilter::predict(const State& x, const Vec2& u_alphabeta,
                                            double omega_e) const {
  State B_u = State::Zero();
  B_u.head<2>() = u_alphabeta.cwiseQuotient(L_);
  switch (prediction_) {
    case Prediction::kEuler:
      return transition(omega_e) * x + T_s_ * B_u;
    case Prediction::kRk4: {
      const Eigen::Matrix4d A_c = A(omega_e);
      return rk4_step<State>([&](const State& s) -> State { return A_c * s + B_u; }, x, T_s_);
    }
    case Prediction::kExact: {
      Eigen::Matrix<double, 4, 2> B = Eigen::Matrix<double, 4, 2>::Zero();
      B(0, 0) = 1 / L_[0];
      B(1, 1) = 1 / L_[1];
      const auto d = discretise_exact<4, 2>(A(omega_e), B, T_s_);
      return d.A * x + d.B * u_alphabeta;
    }
  }
  return x;
}

FastState BackEmfFilter::start(const Measurement& first) const {
  FastState state;
  state.x_hat.head<2>() = clarke(first.i_abc);
  state.x_hat.segment<2>(2) = inverse_park({0, start_.omega_e * machine_.psi_f}, start_.theta_e);
  state.emf_angle = emf_angle_at(start_.theta_e, start_.omega_e);
  return state;
}

void BackEmfFilter::process_angle(FastState& state) const {
  const Vec2 i = state.x_hat.head<2>(), e = state.x_hat.segment<2>(2);
  double psi = machine_.psi_f;
  if (tuning_.angle.saliency_in_speed) {
    const double i_d = park(i, state.emf_angle.theta_now(T_s_))[0];
    psi = std::max(0.1 * psi, psi + (machine_.L_d - machine_.L_q) * i_d);
  }
  state.emf_angle = emf_angle_step(state.emf_angle, tuning_.angle, e, psi, T_s_);
}

Correction BackEmfFilter::fast_step(FastState& state, const Measurement& m,
                                    const Gain& gain) const {
  const State x_prior = predict(state.x_hat.head<4>(), m.u_alphabeta, state.emf_angle.omega_f);
  const Vec2 innov = clarke(m.i_abc) - x_prior.head<2>();
  const State x = x_prior + gain.K.topLeftCorner<4, 2>() * innov;
  Correction correction;
  if (!x.allFinite()) {
    predict_over_gap(state, m);
    correction.status = kNotFinite;
    return correction;
  }
  state.x_hat.head<4>() = x;
  process_angle(state);
  correction.innov.head<2>() = innov;
  return correction;
}

void BackEmfFilter::predict_over_gap(FastState& state, const Measurement& last) const {
  const State x = predict(state.x_hat.head<4>(), last.u_alphabeta, state.emf_angle.omega_f);
  if (x.allFinite()) state.x_hat.head<4>() = x;
  process_angle(state);
}

void BackEmfFilter::align(FastState& state, double theta_e) const {
  state.x_hat.segment<2>(2).setZero();
  state.emf_angle = emf_angle_at(theta_e, 0);
}

Estimate BackEmfFilter::output(const FastState& state, const Measurement&) const {
  Estimate e;
  e.n_x = 4;
  e.n_y = 2;
  e.theta_e = state.emf_angle.theta_now(T_s_);
  e.omega_m = state.emf_angle.omega_f / machine_.n_p;
  e.i_dq = park(state.x_hat.head<2>(), e.theta_e);
  return e;
}

Gain BackEmfFilter::initial_gain() const {
  Gain gain;
  gain.n_x = 4;
  gain.n_y = 2;
  gain.P.topLeftCorner<4, 4>() = Eigen::Map<const State>(tuning_.P0_diag).asDiagonal();
  return gain;
}

Gain BackEmfFilter::background_step(const Gain& previous, const Estimate& snapshot) const {
  const Eigen::Matrix4d Phi = transition(machine_.n_p * snapshot.omega_m);
  const Eigen::Matrix4d Q = Eigen::Map<const State>(tuning_.Q_diag).asDiagonal();
  const Eigen::Matrix4d P_prior = Phi * previous.P.topLeftCorner<4, 4>() * Phi.transpose() + Q;
  const Eigen::Matrix<double, 2, 4> H = Eigen::Matrix<double, 2, 4>::Identity();
  const Eigen::Matrix2d R = Eigen::Map<const Vec2>(tuning_.R_diag).asDiagonal();
  return gain_from_prior<4, 2>(previous, snapshot, P_prior, H, R,
                               covariance_ != CovarianceForm::kPaper);
}

Estimate BackEmfFilter::ahead(const Estimate& snapshot, double ticks) const {
  const double turned = ticks * T_s_ * machine_.n_p * snapshot.omega_m;
  Estimate e = snapshot;
  e.x_hat.head<2>() = rotate(Vec2(snapshot.x_hat.head<2>()), turned);
  e.x_hat.segment<2>(2) = rotate(Vec2(snapshot.x_hat.segment<2>(2)), turned);
  e.theta_e = snapshot.theta_e + turned;
  return e;
}

std::optional<Estimate> BackEmfFilter::steady_state(double omega_m) const {
  Estimate e;
  e.n_x = 4;
  e.n_y = 2;
  e.omega_m = omega_m;
  e.x_hat[3] = machine_.n_p * omega_m * machine_.psi_f;
  return e;
}

}  // namespace twinrate
