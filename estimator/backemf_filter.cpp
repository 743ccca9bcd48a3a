#include "estimator/backemf_filter.hpp"

#include "model/discretise_exact.hpp"
#include "model/math.hpp"

namespace twinrate {

BackEmfFilter::BackEmfFilter(const MachineParameters& machine, const Vec2& L,
                             const BackEmfParameters& tuning, Prediction prediction,
                             CovarianceForm covariance, double T_s, KnownStart start)
    : Ekf({tuning.Q_diag, tuning.R_diag, tuning.P0_diag, covariance}),
      machine_(machine),
      L_(L),
      rotation_(tuning.rotation),
      angle_(tuning.angle),
      prediction_(prediction),
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

BackEmfFilter::Covariance BackEmfFilter::transition(double omega_e) const {
  Eigen::Matrix4d Phi = Eigen::Matrix4d::Identity() + T_s_ * A(omega_e);
  if (rotation_ == Rotation::kExact) {
    const auto [s, c] = math::sincos(omega_e * T_s_);
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

void BackEmfFilter::remember(FastState& state, const State&, const Measurement&, bool) const {
  const Vec2 i = state.x_hat.head<2>(), e = state.x_hat.segment<2>(2);
  double psi = machine_.psi_f;
  if (angle_.saliency_in_speed) {
    const double i_d = park(i, state.emf_angle.theta_now(T_s_))[0];
    psi = std::max(0.1 * psi, psi + (machine_.L_d - machine_.L_q) * i_d);
  }
  state.emf_angle = emf_angle_step(state.emf_angle, angle_, e, psi, T_s_);
}

BackEmfFilter::State BackEmfFilter::prior(const FastState& state, const Measurement& m) const {
  return predict(state.x_hat.head<4>(), m.u_alphabeta, state.emf_angle.omega_f);
}

BackEmfFilter::Output BackEmfFilter::innovation(const State& x_prior, const Measurement& m) const {
  return clarke(m.i_abc) - x_prior.head<2>();
}

void BackEmfFilter::align(FastState& state, double theta_e) const {
  state.x_hat.segment<2>(2).setZero();
  state.emf_angle = emf_angle_at(theta_e, 0);
}

void BackEmfFilter::describe(const FastState& state, const Measurement&, Estimate& e) const {
  e.theta_e = state.emf_angle.theta_now(T_s_);
  e.omega_m = state.emf_angle.omega_f / machine_.n_p;
  e.i_dq = park(state.x_hat.head<2>(), e.theta_e);
}

Gain BackEmfFilter::background_step(const Gain& previous, const Estimate& snapshot) const {
  const Covariance Phi = transition(machine_.n_p * snapshot.omega_m);
  const OutputMatrix H = OutputMatrix::Identity();
  return covariance_step(previous, snapshot, Phi, H, tuning());
}

std::optional<CovarianceModel> BackEmfFilter::covariance_model(const Estimate& snapshot) const {
  return model_of(transition(machine_.n_p * snapshot.omega_m),
                  OutputMatrix(OutputMatrix::Identity()), tuning());
}

Estimate BackEmfFilter::ahead(const Estimate& snapshot, double ticks) const {
  return turned(snapshot, 2, ticks * T_s_ * machine_.n_p * snapshot.omega_m);
}

std::optional<Estimate> BackEmfFilter::steady_state(double omega_m) const {
  FastState state;
  state.x_hat[3] = machine_.n_p * omega_m * machine_.psi_f;
  Estimate e = estimate_of(state, {});
  e.omega_m = omega_m;
  return e;
}

}  // namespace twinrate
