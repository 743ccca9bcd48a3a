#include "estimator/gain_schedule.hpp"

#include <algorithm>

#include "estimator/gain_frame.hpp"
#include "estimator/kernels/riccati_doubling.hpp"

namespace twinrate {
namespace {

constexpr int kRows = 257;
constexpr int kIterations = 20000;
constexpr double kConverged = 1e-12;

using Model = CovarianceModel;
using Map = kernel::RiccatiMap<Eigen::Dynamic, kMaxStates>;

// `steps` background steps of a model in rotor coordinates, by doubling: P before the first and
// after the last. `T`: P of step k-1 in the axes of tick k is T P T'.
Model::Matrix after_steps(const Model& m, const Model::Matrix& T, const Model::Matrix& P,
                          int steps) {
  const Model::Matrix Q = m.Q_diag.asDiagonal(), A = m.F * T;
  const Model::Matrix G = m.H.transpose() * m.R_diag.cwiseInverse().asDiagonal() * m.H;
  const Map map{A, G, Q};
  const Model::Matrix P_prior = kernel::riccati_steps(map, A * P * A.transpose() + Q, steps - 1);
  const Model::Matrix later = P_prior * Model::Matrix(map.one() + G * P_prior).inverse();
  return 0.5 * (later + later.transpose());
}

// The same in place, if the filter has a model and the result is finite.
bool settle_by_doubling(const Filter& filter, const Estimate& at, double angle, Gain& gain) {
  const std::optional<Model> model = filter.covariance_model(at);
  if (!model) return false;
  const int n_x = static_cast<int>(model->F.rows());
  Gain T;
  T.n_x = n_x;
  T.P.topLeftCorner(n_x, n_x).setIdentity();
  GainFrame(filter.turning_pairs(), angle).turn_rows(T.P, n_x);
  const Model::Matrix P = after_steps(*model, T.P.topLeftCorner(n_x, n_x),
                                      gain.P.topLeftCorner(n_x, n_x), kIterations - 1);
  if (!P.allFinite()) return false;
  gain.P.topLeftCorner(n_x, n_x) = P;
  return true;
}

// The filter's own background step in rotor coordinates, kIterations times or until K converges.
// `gain` holds the initial P, and the result. Stops if no steps are left.
void converge(const Filter& filter, double omega_m, Gain& gain, std::int64_t& steps_left) {
  const Estimate e = *filter.steady_state(omega_m);
  const double angle = e.theta_e - filter.ahead(e, 1).theta_e;
  const GainFrame back(filter.turning_pairs(), angle);
  if (settle_by_doubling(filter, e, angle, gain)) {
    back.turn_covariance(gain);
    filter.update_gain(gain, e);
    return;
  }
  GainSchedule::GainMatrix before;
  for (int i = 0; i < kIterations && steps_left > 0; ++i, --steps_left) {
    before = gain.K;
    back.turn_covariance(gain);
    filter.update_gain(gain, e);
    const auto K = gain.K.topLeftCorner(gain.n_x, gain.n_y);
    const double change = (K - before.topLeftCorner(gain.n_x, gain.n_y)).lpNorm<Eigen::Infinity>();
    if (change <= kConverged * K.lpNorm<Eigen::Infinity>()) return;
  }
}

}  // namespace

std::optional<CovarianceModel::Matrix> settled_covariance(const Filter& filter, double omega_m) {
  const std::optional<Estimate> at = filter.steady_state(omega_m);
  if (!at) return {};
  Gain gain = filter.initial_gain();
  const double angle = at->theta_e - filter.ahead(*at, 1).theta_e;
  if (!settle_by_doubling(filter, *at, angle, gain)) return {};
  return gain.P.topLeftCorner(gain.n_x, gain.n_x);
}

std::shared_ptr<const GainSchedule> GainSchedule::build(const Filter& filter, double omega_m_max,
                                                        std::int64_t most_steps) {
  if (!filter.steady_state(0)) return nullptr;
  const std::shared_ptr<const GainSchedule> table(
      new GainSchedule(filter, omega_m_max, most_steps));
  return most_steps > 0 ? table : nullptr;
}

// Rows lie at (row/last)^2 of the range.
double GainSchedule::speed_of(int row) const {
  const double share = static_cast<double>(row) / (kRows - 1);
  return omega_m_max_ * share * share;
}
double GainSchedule::row_of(double omega_m) const {
  return (kRows - 1) * std::sqrt(std::min(1.0, std::abs(omega_m) / omega_m_max_));
}

GainSchedule::GainSchedule(const Filter& filter, double omega_m_max, std::int64_t& steps_left)
    : pairs_(filter.turning_pairs()), omega_m_max_(omega_m_max), K_(kRows) {
  Gain gain = filter.initial_gain();
  converge(filter, -omega_m_max_, gain, steps_left);
  const GainMatrix K_backwards = gain.K;
  gain = filter.initial_gain();
  for (int row = kRows - 1; row >= 0; --row) {  // slow rows start from the row above
    converge(filter, speed_of(row), gain, steps_left);
    K_[static_cast<std::size_t>(row)] = gain.K;
  }
  sign_ = (K_backwards.array() * K_.back().array() < 0).select(-GainMatrix::Ones(), 1.0);
  shape_ = filter.initial_gain();
  shape_.n_x = gain.n_x;
  shape_.n_y = gain.n_y;
}

GainSchedule::GainMatrix GainSchedule::rotor_gain(double omega_m) const {
  const double position = row_of(omega_m);
  const auto row = std::min(static_cast<std::size_t>(position), K_.size() - 2);
  const double low = speed_of(static_cast<int>(row)), high = speed_of(static_cast<int>(row) + 1);
  const double share = std::clamp((std::abs(omega_m) - low) / (high - low), 0.0, 1.0);
  const GainMatrix K = K_[row] + share * (K_[row + 1] - K_[row]);
  return omega_m < 0 ? GainMatrix(K.cwiseProduct(sign_)) : K;
}

Gain GainSchedule::at(double omega_m, double theta_e) const {
  Gain gain = shape_;
  gain.theta_e = theta_e;
  gain.K = rotor_gain(std::isfinite(omega_m) ? omega_m : 0.0);
  GainFrame(pairs_, theta_e).turn_gain(gain);
  return gain;
}

}  // namespace twinrate
