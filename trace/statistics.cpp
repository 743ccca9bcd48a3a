#include "trace/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace twinrate {
namespace {

// Regularised upper incomplete gamma function: series below a + 1, continued fraction above.
double gamma_tail(double a, double x) {
  if (x <= 0) return 1;
  int sign = 0;  // std::lgamma writes it into a global variable: a race between threads
  const double front = std::exp(-x + a * std::log(x) - ::lgamma_r(a, &sign));
  if (x < a + 1) {
    double term = 1 / a, sum = term;
    for (int n = 1; n < 10000 && term > 1e-16 * sum; ++n) sum += term *= x / (a + n);
    return 1 - sum * front;
  }
  double b = x + 1 - a, c = 1e300, d = 1 / b, h = d;
  for (int n = 1; n < 10000; ++n) {
    const double an = -n * (n - a);
    b += 2;
    d = 1 / (an * d + b);
    c = b + an / c;
    const double step = d * c;
    h *= step;
    if (std::abs(step - 1) < 1e-14) break;
  }
  return front * h;
}

}  // namespace

double chi_square_tail(double x, double k) {
  return gamma_tail(k / 2, x / 2);
}

double signed_rank_tail(const std::vector<double>& votes) {
  constexpr std::size_t kExact = 100;  // votes: above it, the sum of ranks is normal
  const std::size_t n = votes.size();
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return std::abs(votes[a]) < std::abs(votes[b]); });
  std::size_t sum = 0;
  for (std::size_t i = 0; i < n; ++i)
    if (votes[order[i]] > 0) sum += i + 1;
  const std::size_t all = n * (n + 1) / 2;
  if (n > kExact) {
    const double mean = 0.5 * static_cast<double>(all),
                 variance = static_cast<double>(all) * static_cast<double>(2 * n + 1) / 12;
    return 0.5 * std::erfc((static_cast<double>(sum) - 0.5 - mean) / std::sqrt(2 * variance));
  }
  std::vector<double> chance(all + 1, 0.0);  // probability of each sum of ranks
  chance[0] = 1;
  for (std::size_t rank = 1; rank <= n; ++rank)
    for (std::size_t s = rank * (rank + 1) / 2 + 1; s-- > 0;)
      chance[s] = 0.5 * (chance[s] + (s >= rank ? chance[s - rank] : 0));
  return std::accumulate(chance.begin() + static_cast<std::ptrdiff_t>(sum), chance.end(), 0.0);
}

double whiteness_p_value(const Eigen::VectorXd& e, const Runs& runs, int lags, int fitted) {
  if (e.size() < 4 * lags) return 1;
  Eigen::VectorXd c = Eigen::VectorXd::Zero(lags + 1), pairs = c;
  for (std::size_t r = 0; r < runs.start.size(); ++r) {
    const auto first = static_cast<Eigen::Index>(runs.start[r]);
    const auto end =
        static_cast<Eigen::Index>(r + 1 < runs.start.size() ? runs.start[r + 1] : runs.row.size());
    for (Eigen::Index lag = 0; lag <= lags && lag < end - first; ++lag) {
      c[lag] += e.segment(first + lag, end - first - lag).dot(e.segment(first, end - first - lag));
      pairs[lag] += static_cast<double>(end - first - lag);
    }
  }
  double Q = 0;
  for (Eigen::Index lag = 1; lag <= lags; ++lag)
    if (pairs[lag] > 0 && c[0] > 0) {
      const double r = c[lag] / pairs[lag] / (c[0] / pairs[0]);
      Q += pairs[lag] * r * r;
    }
  return chi_square_tail(Q, lags - fitted);
}

}  // namespace twinrate
