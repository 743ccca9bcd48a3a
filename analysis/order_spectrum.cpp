#include "analysis/order_spectrum.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cassert>
#include <cmath>
#include <complex>

#include "model/frames.hpp"
#include "model/math.hpp"
#include "model/pair.hpp"

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

// Half the angle between the neighbours of each sample over its mean, limited against gaps and
// quantised angles.
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

// The last whole turns of a stretch in one direction; turns = 0 where it covers less than one.
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

// Of e^{jm theta} of all samples.
struct Sums {
  Pair weights{};  // sum w e^{jm theta}
  Pair values{};   // sum w y e^{jm theta}, for m <= N alone
};

// A sample and its power w e^{jm theta}.
struct Sample {
  Pair power{}, y{}, cos{}, sin{};  // sin: [-s, s]

  Sample() = default;  // counts nothing
  Sample(double weight, double value, const math::SinCos& at)
      : power{weight, 0}, y{value, value}, cos{at.cos, at.cos}, sin{-at.sin, at.sin} {}
  void turn() { power = power * cos + swapped(power) * sin; }
};

// For m = 0 .. 2 N, sample after sample. The powers of four samples are computed beside each other:
// one alone would wait for each product.
std::vector<Sums> sums_of_powers(std::span<const double> theta, std::span<const double> y, int N) {
  const std::vector<double> w = weights(theta);
  std::vector<Sums> sums(2 * static_cast<std::size_t>(N) + 1);
  const std::span<Sums> with_values = std::span(sums).first(static_cast<std::size_t>(N) + 1);
  const auto sample = [&](std::size_t i) {
    return i < theta.size() ? Sample(w[i], y[i], math::sincos(theta[i])) : Sample();
  };
  for (std::size_t i = 0; i < theta.size(); i += 4) {
    Sample a = sample(i), b = sample(i + 1), c = sample(i + 2), d = sample(i + 3);
    const auto add_weights = [&](Sums& at) {
      at.weights = at.weights + a.power + b.power + c.power + d.power;
      a.turn(), b.turn(), c.turn(), d.turn();
    };
    for (Sums& at : with_values) {
      at.values = at.values + a.y * a.power + b.y * b.power + c.y * c.power + d.y * d.power;
      add_weights(at);
    }
    for (Sums& at : std::span(sums).subspan(with_values.size())) add_weights(at);
  }
  return sums;
}

// Coefficients c_{-N} .. c_N of sum c_M e^{jM theta} by least squares.
Eigen::VectorXcd fit(std::span<const double> theta, std::span<const double> y, int N) {
  const std::vector<Sums> sums = sums_of_powers(theta, y, N);
  const auto moment = [&](int m) {
    const Pair& sum = sums[std::abs(m)].weights;
    return Complex(sum[0], m >= 0 ? sum[1] : -sum[1]);
  };
  Eigen::MatrixXcd gram(2 * N + 1, 2 * N + 1);
  Eigen::VectorXcd right(2 * N + 1);
  for (int row = -N; row <= N; ++row) {
    const int m = std::abs(row);
    const Pair& sum = sums[m].values;
    right[row + N] = {sum[0], row >= 0 ? -sum[1] : sum[1]};
    for (int col = -N; col <= N; ++col) gram(row + N, col + N) = moment(col - row);
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

OrderSpectrum order_spectrum(std::span<const double> theta_m, std::span<const double> signal,
                             int N_max) {
  assert(theta_m.size() == signal.size() && N_max >= 1);
  std::vector<double> theta, y;
  std::vector<std::size_t> index;
  theta.reserve(theta_m.size());
  y.reserve(theta_m.size());
  index.reserve(theta_m.size());
  for (std::size_t i = 0; i < theta_m.size(); ++i) {
    if (!std::isfinite(theta_m[i]) || !std::isfinite(signal[i])) continue;
    theta.push_back(theta_m[i]);
    y.push_back(signal[i]);
    index.push_back(i);
  }
  OrderSpectrum spectrum;
  const auto [range, turns] = last_whole_turns(theta, longest_stretch(theta));
  if (turns < 1) return spectrum;
  const auto [first, last] = range;
  const std::size_t count = last - first;
  const int resolved = static_cast<int>(static_cast<double>(count) / turns / kSamplesPerPeriod_min);
  const int N = std::min(N_max, resolved);
  if (N < 1) return spectrum;
  const Eigen::VectorXcd c =
      fit(std::span(theta).subspan(first, count), std::span(y).subspan(first, count), N);
  spectrum.turns = turns;
  spectrum.first = index[first];
  spectrum.last = index[last - 1] + 1;
  spectrum.mean = c[N].real();
  for (int order = 1; order <= N; ++order) {
    spectrum.amplitude.push_back(2 * std::abs(c[N + order]));
    spectrum.phase_rad.push_back(wrap_pi(math::arg(c[N + order]) + kPi / 2));
  }
  return spectrum;
}

}  // namespace twinrate
