#include "trace/signals.hpp"

namespace twinrate {

namespace {

Eigen::Index reach_of(int rows_each) {
  return std::max(2, 5 / rows_each);
}

// Of the sample j rows away, for a quadratic through 2 m + 1.
double weight(double m, double j) {
  return 3 * (3 * m * m + 3 * m - 1 - 5 * j * j) / ((2 * m - 1) * (2 * m + 1) * (2 * m + 3));
}

}  // namespace

double own_share(int rows_each) {
  return weight(static_cast<double>(reach_of(rows_each)), 0);
}

std::vector<Vec2> smoothed(const std::vector<Vec2>& x, int rows_each) {
  const Eigen::Index reach = reach_of(rows_each);
  std::vector<Vec2> out = x;
  const Eigen::Index inner = static_cast<Eigen::Index>(x.size()) - 2 * reach;
  if (inner <= 0) return out;
  // Both components in sequence, all at once.
  const Eigen::Map<const Eigen::ArrayXd> in(x.front().data(), 2 * (inner + 2 * reach));
  const auto at = [&](Eigen::Index j) { return in.segment(2 * (reach + j), 2 * inner); };
  const auto m = static_cast<double>(reach);
  Eigen::ArrayXd sum = weight(m, 0) * at(0);
  for (Eigen::Index j = 1; j <= reach; ++j)
    sum += weight(m, static_cast<double>(j)) * (at(-j) + at(j));
  Eigen::Map<Eigen::ArrayXd>(out.front().data(), 2 * (inner + 2 * reach))
      .segment(2 * reach, 2 * inner) = sum;
  return out;
}

std::vector<double> smooth_rate(const std::vector<double>& theta_m, double T_s, int rows_each) {
  const std::ptrdiff_t reach = std::max(2, 10 / rows_each);  // half-width of the fit, rows
  const auto n = static_cast<std::ptrdiff_t>(theta_m.size());
  std::vector<double> omega_m(theta_m.size(), 0.0);
  const auto slope = [&](std::ptrdiff_t k, std::ptrdiff_t h) {
    double sum = 0, weight = 0;
    for (std::ptrdiff_t j = 1; j <= h; ++j) {
      sum += static_cast<double>(j) * (theta_m[k + j] - theta_m[k - j]);
      weight += static_cast<double>(2 * j * j);
    }
    return weight > 0 ? sum / (weight * T_s) : 0;
  };
  for (std::ptrdiff_t k = 0; k < n; k = k == reach - 1 ? std::max(k + 1, n - reach) : k + 1)
    omega_m[k] = slope(k, std::min({reach, k, n - 1 - k}));
  // The inner samples, all at once.
  const Eigen::Index inner = n - 2 * reach;
  if (inner <= 0) return omega_m;
  const Eigen::Map<const Eigen::ArrayXd> theta(theta_m.data(), n);
  Eigen::Map<Eigen::ArrayXd> out(omega_m.data() + reach, inner);
  double weight = 0;
  for (Eigen::Index j = 1; j <= reach; ++j) {
    out += static_cast<double>(j) *
           (theta.segment(reach + j, inner) - theta.segment(reach - j, inner));
    weight += static_cast<double>(2 * j * j);
  }
  out /= weight * T_s;
  return omega_m;
}

}  // namespace twinrate
