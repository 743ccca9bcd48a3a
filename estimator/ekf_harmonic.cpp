#include "estimator/ekf_harmonic.hpp"

#include <Eigen/LU>

#include "model/math.hpp"
#include "model/point_of.hpp"

namespace twinrate {
namespace {

constexpr int kNeeds = kPhaseCurrents | kVoltage | kPosition;

bool complete(const Measurement& m) {
  return (m.signals & kNeeds) == kNeeds;
}

// Of the four states of the drive, then of every oscillator state.
EkfHarmonic::State diagonal(const double (&of_drive)[4], double of_order, int n_x) {
  EkfHarmonic::State d = EkfHarmonic::State::Constant(n_x, of_order);
  d.head<4>() = Eigen::Map<const Eigen::Vector4d>(of_drive);
  return d;
}

}  // namespace

EkfHarmonic::EkfHarmonic(const MachineParameters& machine, const EkfHarmonicParameters& tuning,
                         Prediction prediction, CovarianceForm covariance, double T_s)
    : machine_(machine),
      orders_(tuning.orders),
      Q_diag_(diagonal(tuning.Q_diag, tuning.Q_order, n_x())),
      P0_diag_(diagonal(tuning.P0_diag, tuning.P0_order, n_x())),
      R_diag_(tuning.R_diag),
      L_(tuning.L),
      drive_(machine, {}, prediction, covariance, T_s),
      covariance_(covariance),
      T_s_(T_s) {}

OperatingPoint EkfHarmonic::point(const State& x, double theta_m, double t) const {
  return point_of(t, frame_at(theta_m, x[2], machine_.n_p), x.head<2>());
}

EkfHarmonic::State EkfHarmonic::predict(const State& x, const Vec2& u_dq, double dtheta_m,
                                        double T_known) const {
  State next(n_x());
  double T_o = x[3] + T_known;
  for (std::size_t j = 0; j < orders_.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(4 + 2 * j);
    // The load of this step is the one in mid-interval.
    const Vec2 mid = rotate(x.segment<2>(i), -0.5 * orders_[j] * dtheta_m);
    T_o += mid[0];
    next.segment<2>(i) = rotate(mid, -0.5 * orders_[j] * dtheta_m);
  }
  next.head<4>() = drive_.predict({x[0], x[1], x[2], T_o}, u_dq);
  next[3] = x[3];
  return next;
}

EkfHarmonic::Covariance EkfHarmonic::jacobian(const State& x) const {
  Covariance F = Covariance::Identity(n_x(), n_x());
  F.topLeftCorner<4, 4>() = drive_.jacobian(x.head<4>());
  for (std::size_t j = 0; j < orders_.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(4 + 2 * j);
    const double N = orders_[j];
    const auto [s, c] = math::sincos(N * T_s_ * x[2]);
    F(2, i) = -T_s_ / machine_.J;
    F.block<2, 2>(i, i) << c, s, -s, c;  // turned by the measured angle: no d/d omega_m
  }
  return F;
}

FastState EkfHarmonic::start(const Measurement& first) const {
  FastState state;
  state.theta_m_prev = first.theta_m;
  if (first.signals & kPhaseCurrents)
    state.x_hat.head<2>() = park(clarke(first.i_abc), machine_.n_p * first.theta_m);
  if (first.signals & kSpeed) state.x_hat[2] = first.omega_m;
  return state;
}

Correction EkfHarmonic::fast_step(FastState& state, const Measurement& m, const Gain& gain) const {
  if (!complete(m)) {
    predict_over_gap(state, m);
    return {};
  }
  const double theta_m_mid = 0.5 * (state.theta_m_prev + m.theta_m);
  const double dtheta_m = m.theta_m - state.theta_m_prev;
  const State x = state.x_hat.head(n_x());
  const double t = 1e-9 * static_cast<double>(m.t_ns);
  State x_prior = predict(x, park(m.u_alphabeta, machine_.n_p * theta_m_mid), dtheta_m,
                          known().torque(point(x, theta_m_mid, t)));
  const double omega_m = m.signals & kSpeed ? m.omega_m : dtheta_m / T_s_;
  Eigen::Vector3d y;
  y << park(clarke(m.i_abc), machine_.n_p * m.theta_m), omega_m;
  const Eigen::Vector3d innov = y - x_prior.head<3>();
  State x_hat = x_prior;
  x_hat[3] += L_ * T_s_ * innov[2];
  if (gain.n_x == n_x()) x_hat += gain.K.topLeftCorner(n_x(), 3) * innov;
  state.theta_m_prev = m.theta_m;
  return take_over(state, x_hat, x_prior, innov);
}

void EkfHarmonic::predict_over_gap(FastState& state, const Measurement& last) const {
  const State x = state.x_hat.head(n_x());
  const double dtheta_m = T_s_ * x[2], theta_m_mid = state.theta_m_prev + 0.5 * dtheta_m;
  const State next =
      predict(x, park(last.u_alphabeta, machine_.n_p * theta_m_mid), dtheta_m,
              known().torque(point(x, theta_m_mid, 1e-9 * static_cast<double>(last.t_ns))));
  state.theta_m_prev += dtheta_m;
  if (next.allFinite()) state.x_hat.head(n_x()) = next;
}

Estimate EkfHarmonic::output(const FastState& state, const Measurement& m) const {
  const State x = state.x_hat.head(n_x());
  Estimate e;
  e.status = kMeasuredAngle;
  e.n_x = n_x();
  e.n_y = 3;
  e.theta_e = wrap_turn(machine_.n_p * m.theta_m);
  e.i_dq = x.head<2>();
  e.omega_m = x[2];
  const double t = 1e-9 * static_cast<double>(m.t_ns);
  const double T_known = known().load(point(x, m.theta_m, t));
  e.T_load = x[3] + T_known;
  e.dT_load_dt = (known().load(point(x, m.theta_m + T_s_ * x[2], t)) - T_known) / T_s_;
  for (std::size_t j = 0; j < orders_.size(); ++j) {
    const auto i = static_cast<Eigen::Index>(4 + 2 * j);
    e.T_load += x[i];
    e.dT_load_dt += orders_[j] * x[2] * x[i + 1];
  }
  return e;
}

Gain EkfHarmonic::initial_gain() const {
  return first_gain({P0_diag_.data(), static_cast<std::size_t>(n_x())}, 3);
}

std::optional<Estimate> EkfHarmonic::steady_state(double omega_m) const {
  FastState state;
  state.x_hat[2] = omega_m;
  return estimate_of(state, {});
}

std::optional<CovarianceModel> EkfHarmonic::covariance_model(const Estimate& snapshot) const {
  return CovarianceModel{jacobian(snapshot.x_hat.head(n_x())),
                         CovarianceModel::Outputs::Identity(3, n_x()), Q_diag_, R_diag_};
}

Gain EkfHarmonic::background_step(const Gain& previous, const Estimate& snapshot) const {
  const int n = n_x();
  const Covariance F = jacobian(snapshot.x_hat.head(n));
  Covariance P = F * previous.P.topLeftCorner(n, n);
  P = (P * F.transpose()).eval();
  P.diagonal() += Q_diag_;
  // y = the first three states: S is a corner of P, and P H' its first columns.
  Eigen::Matrix3d S = P.topLeftCorner<3, 3>();
  S += R_diag_.asDiagonal();
  using GainMatrix = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMaxStates, 3>;
  const GainMatrix K = P.leftCols<3>() * S.inverse();
  Covariance P_post = P;
  if (covariance_ == CovarianceForm::kJoseph) {
    Covariance I_KH = Covariance::Identity(n, n);
    I_KH.leftCols<3>() -= K;
    P_post = I_KH * P;
    P_post = (P_post * I_KH.transpose()).eval();
    const GainMatrix KR = K * R_diag_.asDiagonal();
    P_post += KR * K.transpose();
  } else {
    P_post -= K * P.topRows<3>();
  }
  return gain_of_snapshot(previous, snapshot, K, 0.5 * (P_post + P_post.transpose()));
}

}  // namespace twinrate
