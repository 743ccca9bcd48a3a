#include "trace/signals.hpp"

namespace twinrate {

std::vector<Vec2> smoothed(const std::vector<Vec2>& x) {
  constexpr Eigen::Index kReach = 5;
  std::vector<Vec2> out = x;
  const Eigen::Index inner = static_cast<Eigen::Index>(x.size()) - 2 * kReach;
  if (inner <= 0) return out;
  // Both components one behind the other, all at once.
  const Eigen::Map<const Eigen::ArrayXd> in(x.front().data(), 2 * (inner + 2 * kReach));
  const auto at = [&](Eigen::Index j) { return in.segment(2 * (kReach + j), 2 * inner); };
  Eigen::Map<Eigen::ArrayXd>(out.front().data(), 2 * (inner + 2 * kReach))
      .segment(2 * kReach, 2 * inner) =
      89. / 429 * at(0) + 84. / 429 * (at(-1) + at(1)) + 69. / 429 * (at(-2) + at(2)) +
      44. / 429 * (at(-3) + at(3)) + 9. / 429 * (at(-4) + at(4)) + -36. / 429 * (at(-5) + at(5));
  return out;
}

std::vector<double> smooth_rate(const std::vector<double>& theta_m, double T_s) {
  constexpr std::ptrdiff_t kSmooth = 10;  // half-width of the fit, rows
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
  for (std::ptrdiff_t k = 0; k < n; k = k == kSmooth - 1 ? std::max(k + 1, n - kSmooth) : k + 1)
    omega_m[k] = slope(k, std::min({kSmooth, k, n - 1 - k}));
  // The rest, all at once.
  const Eigen::Index inner = n - 2 * kSmooth;
  if (inner <= 0) return omega_m;
  const Eigen::Map<const Eigen::ArrayXd> theta(theta_m.data(), n);
  Eigen::Map<Eigen::ArrayXd> out(omega_m.data() + kSmooth, inner);
  double weight = 0;
  for (Eigen::Index j = 1; j <= kSmooth; ++j) {
    out += static_cast<double>(j) *
           (theta.segment(kSmooth + j, inner) - theta.segment(kSmooth - j, inner));
    weight += static_cast<double>(2 * j * j);
  }
  out /= weight * T_s;
  return omega_m;
}

}  // namespace twinrate
