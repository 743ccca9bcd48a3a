#include "trace/noise.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "model/random.hpp"

namespace twinrate {
namespace {

constexpr Eigen::Index kMostRows = 4000;

// What every candidate together cannot explain of one channel: noise.
Eigen::VectorXd unexplained(const Eigen::VectorXd& y,
                            const std::vector<const Eigen::VectorXd*>& x) {
  if (!y.size()) return y;
  const Eigen::Index n = std::min(y.size(), kMostRows), p = static_cast<Eigen::Index>(x.size());
  if (n < 4 * p || p == 0) return y;
  Eigen::MatrixXd X(n, p);
  for (Eigen::Index c = 0; c < p; ++c) {
    X.col(c) = x[c]->head(n);
    const double norm = X.col(c).norm();
    if (norm > 0) X.col(c) /= norm;
  }
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(p, p);
  G.selfadjointView<Eigen::Lower>().rankUpdate(X.transpose());
  G.diagonal().array() += 1e-8;
  const Eigen::VectorXd c =
      G.selfadjointView<Eigen::Lower>().ldlt().solve(X.transpose() * y.head(n));
  return (y.head(n) - X * c) * std::sqrt(static_cast<double>(n) / static_cast<double>(n - p));
}

Runs first_runs(const Runs& runs, Eigen::Index n) {
  Runs first;
  first.row.assign(runs.row.begin(), runs.row.begin() + n);
  for (std::size_t s : runs.start)
    if (s < static_cast<std::size_t>(n)) first.start.push_back(s);
  return first;
}

// Columns that do not hold the residual's own noise, to estimate that from.
bool is_safe(const Effect& effect) {
  if (effect.regressor_count() == 0) return false;
  for (std::string_view kind :
       {"inductance", "saturation", "cross_saturation", "inertia", "voltage_gain", "current_gain",
        "iron_loss", "encoder_eccentricity"})
    if (effect.kind() == kind) return false;
  return true;
}

// Noise of a slow signal that is sampled fast: its fourth difference, median over the rows asked
// for.
template <class Value>
double white_noise(std::size_t n, Value&& value, const std::vector<char>& use) {
  std::vector<double> sizes;
  for (std::size_t k = 4; k < n; ++k)
    if (use[k] && use[k - 2] && use[k - 4])
      sizes.push_back(std::abs(value(k) - 4 * value(k - 1) + 6 * value(k - 2) - 4 * value(k - 3) +
                               value(k - 4)));
  if (sizes.empty()) return 0;
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return *middle / 0.6745 / std::sqrt(70.0);
}

}  // namespace

Record add_noise(const Record& record, const std::vector<char>& moving) {
  Record noisier = record;
  const double sigma_theta = white_noise(
      record.size(), [&](std::size_t k) { return record.theta_m[k]; }, moving);
  const double sigma_i =
      record.i_alphabeta.empty()
          ? 0
          : std::sqrt(0.5 * (std::pow(white_noise(
                                          record.size(),
                                          [&](std::size_t k) { return record.i_alphabeta[k][0]; },
                                          record.electrical_ok),
                                      2) +
                             std::pow(white_noise(
                                          record.size(),
                                          [&](std::size_t k) { return record.i_alphabeta[k][1]; },
                                          record.electrical_ok),
                                      2)));
  for (std::size_t k = 0; k < record.size(); ++k) {
    noisier.theta_m[k] += sigma_theta * normal(1, 0, k);
    if (!record.i_alphabeta.empty())
      noisier.i_alphabeta[k] += sigma_i * Vec2(normal(1, 1, k), normal(1, 2, k));
  }
  return noisier;
}

NoiseModel fit_noise(const Chain& chain, const Sampled& y, const Dictionary& dictionary) {
  std::vector<const Eigen::VectorXd*> d, q, torque;
  for (const Candidate& c : dictionary.sampled) {
    if (!is_safe(*c.effect)) continue;
    for (const Sampled& x : c.columns) {
      if (x.d.size()) d.push_back(&x.d), q.push_back(&x.q);
      if (x.torque.size()) torque.push_back(&x.torque);
    }
  }
  const Eigen::VectorXd noise_d = unexplained(y.d, d), noise_q = unexplained(y.q, q),
                        noise_torque = unexplained(y.torque, torque);
  const Sampler& sampler = chain.sampler();
  NoiseModel noise;
  const auto whitener = [](const Eigen::VectorXd& x, const Runs& runs) {
    return x.size() ? Whitener(x, first_runs(runs, x.size())) : Whitener();
  };
  noise.d = whitener(noise_d, sampler.electrical());
  noise.q = whitener(noise_q, sampler.electrical());
  noise.torque = whitener(noise_torque, sampler.torque());
  return noise;
}

}  // namespace twinrate
