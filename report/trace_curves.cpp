#include "report/trace_curves.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <unsupported/Eigen/FFT>

#include "model/frames.hpp"

namespace twinrate::report {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMinRows = 5;               // in a bin
constexpr double kMinPowerKept = 0.9;        // of a signal, by smoothing
constexpr int kMinRowsPerBin = 8;            // mean over the bins of a turn
constexpr double kMinBinsFilled = 0.999;     // share of the bins of a turn
constexpr double kMaxSpacing = 8;            // mean spacing of rows times rate; more: not uniform
constexpr std::size_t kLongRows = 1u << 17;  // longer signals are padded less, to save memory
constexpr double kMaxStep = 1.5;             // spacing of consecutive rows times rate

// Sums of one bin and one kind of rows.
struct Sums {
  double eg = 0, gg = 0, ee = 0, sg = 0, x = 0, rows = 0;  // e: residual less the share

  void add(const Points& p, std::size_t i) {
    const double e = p.e[i] - p.share[i];
    eg += e * p.g[i], gg += p.g[i] * p.g[i], ee += e * e;
    sg += p.share[i] * p.g[i], x += p.x[i], ++rows;
  }
  bool enough() const { return rows >= kMinRows && gg > 0; }
  double left() const { return enough() ? eg / gg : kNaN; }
  double share() const { return sg / gg; }
  double error() const {
    return enough() ? 2 * std::sqrt(std::max(0.0, ee - eg * eg / gg) / (rows - 1) / gg) : kNaN;
  }
};

bool follows(const std::vector<double>& t, std::size_t i, double rate_Hz) {
  return t[i] > t[i - 1] && (t[i] - t[i - 1]) * rate_Hz < kMaxStep;
}

double power(const std::vector<double>& y) {
  double sum = 0;
  for (const double value : y) sum += value * value;
  return sum;
}

// Means over `count` bins of one turn, less their mean; empty if too few bins have rows.
std::vector<double> means_over_turn(const std::vector<double>& theta_m,
                                    const std::vector<double>& y, std::size_t count) {
  std::vector<double> mean(count, 0.0), rows(count, 0.0);
  for (std::size_t i = 0; i < y.size(); ++i) {
    const auto b = std::min(count - 1, static_cast<std::size_t>(wrap_turn(theta_m[i]) / kTwoPi *
                                                                static_cast<double>(count)));
    mean[b] += y[i], ++rows[b];
  }
  double whole = 0, filled = 0;
  for (std::size_t b = 0; b < count; ++b) {
    if (rows[b] == 0) continue;
    mean[b] /= rows[b];
    whole += mean[b], ++filled;
  }
  if (filled < kMinBinsFilled * static_cast<double>(count)) return {};
  for (std::size_t b = 0; b < count; ++b) mean[b] = rows[b] > 0 ? mean[b] - whole / filled : 0;
  return mean;
}

}  // namespace

Bins bin(const Points& p, double lo, double hi, int count) {
  std::vector<Sums> trained(static_cast<std::size_t>(count)), held = trained, all = trained;
  for (std::size_t i = 0; i < p.x.size(); ++i) {
    if (!(p.x[i] >= lo && p.x[i] <= hi)) continue;
    const auto b = std::min(static_cast<std::size_t>(count - 1),
                            static_cast<std::size_t>((p.x[i] - lo) / (hi - lo) * count));
    (p.held_out[i] ? held : trained)[b].add(p, i);
    all[b].add(p, i);
  }
  Bins bins;
  for (std::size_t b = 0; b < all.size(); ++b) {
    if (!all[b].enough()) continue;
    bins.x.push_back(all[b].x / all[b].rows);
    bins.share.push_back(all[b].share());
    bins.trained.push_back(all[b].share() + trained[b].left());
    bins.trained_error.push_back(trained[b].error());
    bins.held_out.push_back(all[b].share() + held[b].left());
    bins.held_out_error.push_back(held[b].error());
  }
  return bins;
}

std::pair<double, double> middle(std::vector<double> x, double share) {
  if (x.empty()) return {0, 0};
  std::sort(x.begin(), x.end());
  const double last = static_cast<double>(x.size() - 1);
  return {x[static_cast<std::size_t>(0.5 * (1 - share) * last)],
          x[static_cast<std::size_t>(0.5 * (1 + share) * last)]};
}

std::vector<double> smooth(const std::vector<double>& y, const std::vector<double>& t,
                           double rate_Hz, std::size_t half) {
  if (half == 0 || y.empty()) return y;
  std::vector<double> sum(y.size() + 1, 0.0), out(y.size());
  for (std::size_t i = 0; i < y.size(); ++i) sum[i + 1] = sum[i] + y[i];
  for (std::size_t from = 0; from < y.size();) {
    std::size_t to = from + 1;
    while (to < y.size() && follows(t, to, rate_Hz)) ++to;
    for (std::size_t i = from; i < to; ++i) {
      const std::size_t h = std::min({half, i - from, to - 1 - i});
      out[i] = (sum[i + h + 1] - sum[i - h]) / static_cast<double>(2 * h + 1);
    }
    from = to;
  }
  return out;
}

std::size_t widest_half(const std::vector<double>& y, const std::vector<double>& t,
                        double rate_Hz) {
  const double whole = power(y);
  std::size_t widest = 0;
  for (std::size_t half = 1; half <= 64; half *= 2) {
    if (power(smooth(y, t, rate_Hz, half)) < kMinPowerKept * whole) break;
    widest = half;
  }
  return widest;
}

std::vector<double> order_amplitudes(const std::vector<double>& theta_m,
                                     const std::vector<double>& y, int highest) {
  const auto min_bins = static_cast<std::size_t>(4 * highest);
  std::vector<double> mean;
  for (std::size_t count = 3 * min_bins; count >= min_bins && mean.empty(); count -= min_bins)
    if (y.size() >= kMinRowsPerBin * count) mean = means_over_turn(theta_m, y, count);
  if (mean.empty()) return {};
  std::vector<double> amplitude;
  const auto count = static_cast<double>(mean.size());
  for (int N = 1; N <= highest; ++N) {
    std::complex<double> sum = 0;
    for (std::size_t b = 0; b < mean.size(); ++b)
      sum += mean[b] * std::polar(1.0, -N * kTwoPi * (static_cast<double>(b) + 0.5) / count);
    // Corrects the attenuation by averaging within a bin.
    const double half = 0.5 * N * kTwoPi / count;
    amplitude.push_back(2 * std::abs(sum) / count * half / std::sin(half));
  }
  return amplitude;
}

Spectrum line_spectrum(const std::vector<double>& t, const std::vector<double>& y, double rate_Hz,
                       std::size_t points) {
  Spectrum spectrum;
  if (y.size() < 64) return spectrum;
  // If time falls or most of the record is missing, the rows are taken as uniform.
  const double span = (t.back() - t.front()) * rate_Hz;
  const bool timed =
      std::is_sorted(t.begin(), t.end()) && span < kMaxSpacing * static_cast<double>(y.size());
  const auto place = [&](std::size_t i) {
    return timed ? static_cast<std::size_t>(std::lround((t[i] - t.front()) * rate_Hz)) : i;
  };
  const std::size_t rows = place(y.size() - 1) + 1;
  std::size_t n = 64;
  const std::size_t padded = rows < kLongRows ? 4 * rows : 2 * rows;  // for lines between two bins
  while (n < padded) n *= 2;
  double mean = 0;
  for (const double value : y) mean += value / static_cast<double>(y.size());
  std::vector<double> x(n, 0.0);
  double weight = 0;
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double phase = kTwoPi * (static_cast<double>(place(i)) + 0.5) / static_cast<double>(rows);
    const double hann = 0.5 * (1 - std::cos(phase));
    x[place(i)] = hann * (y[i] - mean);
    weight += hann;
  }
  std::vector<std::complex<double>> X;
  Eigen::FFT<double>().fwd(X, x);
  const std::size_t lines = n / 2, step = std::max<std::size_t>(1, lines / points);
  for (std::size_t first = 1; first + step <= lines; first += step) {
    double most = 0;
    for (std::size_t k = first; k < first + step; ++k) most = std::max(most, std::abs(X[k]));
    const double centre = static_cast<double>(first) + 0.5 * static_cast<double>(step - 1);
    spectrum.f_Hz.push_back(centre * rate_Hz / static_cast<double>(n));
    spectrum.amplitude.push_back(2 * most / weight);
  }
  spectrum.resolution_Hz = 2 * rate_Hz / static_cast<double>(rows);
  return spectrum;
}

std::vector<std::pair<double, double>> stretches(const std::vector<double>& t,
                                                 const std::vector<char>& held_out) {
  std::vector<std::pair<double, double>> list;
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (!held_out[i]) continue;
    if (i == 0 || !held_out[i - 1]) list.emplace_back(t[i], t[i]);
    list.back().second = t[i];
  }
  return list;
}

}  // namespace twinrate::report
