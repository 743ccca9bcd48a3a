#include "analysis/order_spectrum.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <complex>

#include "analysis/angle_sums.hpp"
#include "model/frames.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

using Complex = std::complex<double>;

constexpr double kReversal_rad = 0.1;  // a smaller step back is sensor jitter
constexpr double kSamplesPerPeriod_min = 2.2;

struct Range {
  std::size_t first = 0, last = 0;
};

// Longest stretch, by angle, without a reversal. The stretches end at the extremes of the angle.
Range longest_stretch(std::span<const double> theta) {
  Range best;
  double best_angle = -1;
  std::size_t start = 0, top = 0;  // first and furthest sample of the present stretch
  double direction = 0;
  const auto close = [&](std::size_t end) {
    const double angle = std::abs(theta[end] - theta[start]);
    if (angle > best_angle) best = {start, end + 1}, best_angle = angle;
  };
  for (std::size_t i = 0; i < theta.size(); ++i) {
    const double from_start = theta[i] - theta[start];
    if (direction == 0 && std::abs(from_start) > kReversal_rad) direction = from_start > 0 ? 1 : -1;
    if (direction * (theta[i] - theta[top]) >= 0) {
      top = i;
    } else if (direction * (theta[i] - theta[top]) < -kReversal_rad) {
      close(top);
      start = top;
      top = i;
      direction = -direction;
    }
  }
  if (!theta.empty()) close(top);
  return best;
}

// Weight of a sample: half the angle between its neighbours over the mean step, limited against
// gaps and quantised angles.
std::vector<double> weights(std::span<const double> theta) {
  const std::size_t count = theta.size();
  const double mean = std::abs(theta[count - 1] - theta[0]) / static_cast<double>(count - 1);
  std::vector<double> w(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double before = theta[i > 0 ? i - 1 : 0], after = theta[i + 1 < count ? i + 1 : i];
    w[i] = std::clamp(std::abs(after - before) / 2 / mean, 0.25, 4.0);
  }
  return w;
}

// The last whole turns of a stretch in one direction; turns = 0 if it is shorter than one turn.
struct WholeTurns {
  Range range{};
  int turns = 0;
};
WholeTurns last_whole_turns(std::span<const double> theta, const Range& stretch) {
  if (stretch.last - stretch.first < 3) return {};
  const double end = theta[stretch.last - 1];
  const auto covered = [&](std::size_t i) { return std::abs(end - theta[i]); };
  // Tolerance of half a step: m turns sampled at uniform angles span one step less than m turns.
  const double mean_step =
      covered(stretch.first) / static_cast<double>(stretch.last - stretch.first - 1);
  const int turns =
      static_cast<int>(std::floor((covered(stretch.first) + 1.5 * mean_step) / kTwoPi));
  if (turns < 1) return {};
  std::size_t first = stretch.first;
  while (covered(first) > kTwoPi * turns - mean_step / 2) ++first;
  return {{first, stretch.last}, turns};
}

// Coefficients c_{-N} .. c_N of sum c_M e^{jM theta} by least squares.
Eigen::VectorXcd fit(std::span<const double> theta, std::span<const double> y, int N) {
  const AngleSums sums = angle_sums(theta, weights(theta), y, 2 * N);
  const auto of = [](const std::vector<Complex>& sum, int m) {
    return m >= 0 ? sum[static_cast<std::size_t>(m)] : std::conj(sum[static_cast<std::size_t>(-m)]);
  };
  Eigen::MatrixXcd gram(2 * N + 1, 2 * N + 1);
  Eigen::VectorXcd right(2 * N + 1);
  for (int row = -N; row <= N; ++row) {
    right[row + N] = of(sums.values, -row);
    for (int col = -N; col <= N; ++col) gram(row + N, col + N) = of(sums.weights, col - row);
  }
  return gram.ldlt().solve(right);
}

}  // namespace

double OrderSpectrum::rms(int N_max) const {
  double sum = 0;
  for (std::size_t i = 0; i < amplitude.size() && i < static_cast<std::size_t>(N_max); ++i)
    sum += amplitude[i] * amplitude[i] / 2;
  return std::sqrt(sum);
}

double OrderSpectrum::noise(int N_max) const {
  const std::size_t count = std::min(amplitude.size(), static_cast<std::size_t>(N_max));
  if (count == 0) return 0;
  std::vector<double> sorted(amplitude.begin(),
                             amplitude.begin() + static_cast<std::ptrdiff_t>(count));
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

double OrderSpectrum::at(double theta_m, int N_max) const {
  double sum = 0;
  for (std::size_t i = 0; i < amplitude.size() && i < static_cast<std::size_t>(N_max); ++i)
    sum += amplitude[i] * math::sin(static_cast<double>(i + 1) * theta_m + phase_rad[i]);
  return sum;
}

double shape_correlation(const OrderSpectrum& a, const OrderSpectrum& b, int N_max, double turned) {
  const auto shared =
      std::min({a.amplitude.size(), b.amplitude.size(), static_cast<std::size_t>(N_max)});
  double product = 0;
  for (std::size_t i = 0; i < shared; ++i)
    product += a.amplitude[i] * b.amplitude[i] / 2 *
               math::cos(a.phase_rad[i] - b.phase_rad[i] - static_cast<double>(i + 1) * turned);
  return product / (a.rms(N_max) * b.rms(N_max));
}

namespace {

bool all_finite(std::span<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

// Of samples that are all finite.
OrderSpectrum spectrum_of(std::span<const double> theta, std::span<const double> y, int N_max) {
  OrderSpectrum spectrum;
  const auto [range, turns] = last_whole_turns(theta, longest_stretch(theta));
  if (turns < 1) return spectrum;
  const auto [first, last] = range;
  const std::size_t count = last - first;
  const int resolved = static_cast<int>(static_cast<double>(count) / turns / kSamplesPerPeriod_min);
  const int N = std::min(N_max, resolved);
  if (N < 1) return spectrum;
  const Eigen::VectorXcd c = fit(theta.subspan(first, count), y.subspan(first, count), N);
  spectrum.turns = turns;
  spectrum.first = first;
  spectrum.last = last;
  spectrum.mean = c[N].real();
  for (int order = 1; order <= N; ++order) {
    spectrum.amplitude.push_back(2 * std::abs(c[N + order]));
    spectrum.phase_rad.push_back(wrap_pi(math::arg(c[N + order]) + kPi / 2));
  }
  return spectrum;
}

}  // namespace

OrderSpectrum order_spectrum(std::span<const double> theta_m, std::span<const double> signal,
                             int N_max) {
  assert(theta_m.size() == signal.size() && N_max >= 1);
  if (all_finite(theta_m) && all_finite(signal)) return spectrum_of(theta_m, signal, N_max);
  std::vector<double> theta, y;
  std::vector<std::size_t> index;
  for (std::size_t i = 0; i < theta_m.size(); ++i) {
    if (!std::isfinite(theta_m[i]) || !std::isfinite(signal[i])) continue;
    theta.push_back(theta_m[i]);
    y.push_back(signal[i]);
    index.push_back(i);
  }
  OrderSpectrum spectrum = spectrum_of(theta, y, N_max);
  if (spectrum.turns == 0) return spectrum;
  spectrum.first = index[spectrum.first];
  spectrum.last = index[spectrum.last - 1] + 1;
  return spectrum;
}

}  // namespace twinrate
