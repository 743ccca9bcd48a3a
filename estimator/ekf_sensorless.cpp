#include "estimator/ekf_sensorless.hpp"

#include <complex>

namespace twinrate {

EkfSensorless::EkfSensorless(const MachineParameters& machine,
                             const EkfSensorlessParameters& tuning, Prediction prediction,
                             CovarianceForm covariance, double T_s, double omega_e_start)
    : a_(machine.R_s / machine.L_d),
      b_(machine.psi_f / machine.L_d),
      inv_L_(1 / machine.L_d),
      n_p_(machine.n_p),
      T_s_(T_s),
      omega_e_start_(omega_e_start),
      prediction_(prediction),
      covariance_(covariance),
      Q_(Eigen::Map<const Eigen::Vector4d>(tuning.Q_diag).asDiagonal()),
      P0_(Eigen::Map<const Eigen::Vector4d>(tuning.P0_diag).asDiagonal()),
      R_(Eigen::Map<const Eigen::Vector2d>(tuning.R_diag).asDiagonal()) {}

EkfSensorless::State EkfSensorless::f(const State& x, const Vec2& u_alphabeta) const {
  const double i_alpha = x[0], i_beta = x[1], omega_e = x[2], theta_e = x[3];
  return {-a_ * i_alpha + b_ * omega_e * std::sin(theta_e) + inv_L_ * u_alphabeta[0],
          -a_ * i_beta - b_ * omega_e * std::cos(theta_e) + inv_L_ * u_alphabeta[1], 0.0, omega_e};
}

// With omega_e constant over the interval: i' = -a i + u/L - j b omega_e exp(j (theta_e + omega_e
// t)).
static Vec2 exact_currents(const EkfSensorless::State& x, const Vec2& u_alphabeta, double a,
                           double b, double inv_L, double T) {
  using Complex = std::complex<double>;
  const Complex j(0, 1), i0(x[0], x[1]), u(u_alphabeta[0], u_alphabeta[1]);
  const double omega_e = x[2], decay = std::exp(-a * T);
  const Complex forced = (std::polar(1.0, omega_e * T) - decay) / (a + j * omega_e);
  const Complex i =
      decay * i0 + inv_L * u * (1 - decay) / a - j * b * omega_e * std::polar(1.0, x[3]) * forced;
  return {i.real(), i.imag()};
}

EkfSensorless::State EkfSensorless::predict(const State& x, const Vec2& u_alphabeta) const {
  const auto rate = [&](const State& s) { return f(s, u_alphabeta); };
  switch (prediction_) {
    case Prediction::kEuler:
      return euler_step<State>(rate, x, T_s_);
    case Prediction::kRk4:
      return rk4_step<State>(rate, x, T_s_);
    case Prediction::kExact: {
      const Vec2 i = exact_currents(x, u_alphabeta, a_, b_, inv_L_, T_s_);
      return {i[0], i[1], x[2], x[3] + T_s_ * x[2]};
    }
  }
  return x;
}

EkfSensorless::Covariance EkfSensorless::jacobian(const State& x) const {
  const double omega_e = x[2], s = std::sin(x[3]), c = std::cos(x[3]);
  Covariance F;
  F << 1 - T_s_ * a_, 0, T_s_ * b_ * s, T_s_ * b_ * omega_e * c,  //
      0, 1 - T_s_ * a_, -T_s_ * b_ * c, T_s_ * b_ * omega_e * s,  //
      0, 0, 1, 0,                                                 //
      0, 0, T_s_, 1;
  return F;
}

FastState EkfSensorless::start(const Measurement& first) const {
  FastState state;
  state.x_hat.head<2>() = clarke(first.i_abc);
  state.x_hat[2] = omega_e_start_;
  return state;
}

Correction EkfSensorless::fast_step(FastState& state, const Measurement& m,
                                    const Gain& gain) const {
  const State x_prior = predict(state.x_hat.head<4>(), m.u_alphabeta);
  Correction correction;
  const Vec2 innov = clarke(m.i_abc) - x_prior.head<2>();
  State x = x_prior + gain.K.topLeftCorner<4, 2>() * innov;
  x[3] = wrap_turn(x[3]);
  if (!x.allFinite()) {
    predict_over_gap(state, m);
    correction.status = kNotFinite;
    return correction;
  }
  state.x_hat.head<4>() = x;
  correction.innov.head<2>() = innov;
  return correction;
}

void EkfSensorless::predict_over_gap(FastState& state, const Measurement& last) const {
  State x = predict(state.x_hat.head<4>(), last.u_alphabeta);
  x[3] = wrap_turn(x[3]);
  if (x.allFinite()) state.x_hat.head<4>() = x;
}

void EkfSensorless::align(FastState& state, double theta_e) const {
  state.x_hat[2] = 0;
  state.x_hat[3] = wrap_turn(theta_e);
}

Estimate EkfSensorless::output(const FastState& state, const Measurement&) const {
  Estimate e;
  e.n_x = 4;
  e.n_y = 2;
  e.theta_e = state.x_hat[3];
  e.omega_m = state.x_hat[2] / n_p_;
  e.i_dq = park(state.x_hat.head<2>(), e.theta_e);
  return e;
}

Gain EkfSensorless::initial_gain() const {
  Gain gain;
  gain.n_x = 4;
  gain.n_y = 2;
  gain.P.topLeftCorner<4, 4>() = P0_;
  return gain;
}

Gain EkfSensorless::background_step(const Gain& previous, const Estimate& snapshot) const {
  const Covariance F = jacobian(snapshot.x_hat.head<4>());
  const Covariance P_prior = F * previous.P.topLeftCorner<4, 4>() * F.transpose() + Q_;
  const Eigen::Matrix<double, 2, 4> H = Eigen::Matrix<double, 2, 4>::Identity();
  return gain_from_prior<4, 2>(previous, snapshot, P_prior, H, R_,
                               covariance_ == CovarianceForm::kJoseph);
}

}  // namespace twinrate
