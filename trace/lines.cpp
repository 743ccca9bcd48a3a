#include "trace/lines.hpp"

#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/FFT>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr double kFalse = 1e-6;   // chance that noise alone makes such a line
constexpr double kLowest_Hz = 1;  // slower is drift
constexpr double kHighestOrder = 60, kLowestOrder = 0.3;
constexpr double kWhole = 0.06;  // of an order: nearer is a whole order, cogging's
constexpr double kFewestTurns = 4;
constexpr double kLongest_s = 2000;  // of a record with gaps

std::size_t power_of_two(double at_least) {
  std::size_t n = 1024;
  while (static_cast<double>(n) < at_least) n *= 2;
  return n;
}

// Of the outputs. Where logs with clocks of their own stand one behind the other, or a long one has
// so wide gaps that the spectrum would take too much memory, as if the rows had none between them.
std::vector<double> times_of(const Runs& runs, const Record& record) {
  std::vector<double> t;
  for (std::size_t row : runs.row) t.push_back(record.t[row]);
  if (std::is_sorted(t.begin(), t.end()) && t.back() - t.front() < kLongest_s) return t;
  for (std::size_t n = 0; n < t.size(); ++n) t[n] = static_cast<double>(runs.row[n]) * record.T_s;
  return t;
}

// y spread onto an even grid of `position` (in cells), and its power by bin.
std::vector<double> spectrum(const Eigen::VectorXd& y, const std::vector<double>& position,
                             std::size_t cells) {
  std::vector<double> grid(cells, 0.0);
  for (Eigen::Index n = 0; n < y.size(); ++n) {
    const double x = position[static_cast<std::size_t>(n)];
    const auto cell = static_cast<std::size_t>(x);
    const double share = x - static_cast<double>(cell);
    grid[cell % cells] += (1 - share) * y[n];
    grid[(cell + 1) % cells] += share * y[n];
  }
  Eigen::FFT<double> fft;
  std::vector<std::complex<double>> bins;
  fft.fwd(bins, grid);
  std::vector<double> power(cells / 2);
  for (std::size_t b = 0; b < power.size(); ++b) power[b] = std::norm(bins[b]);
  return power;
}

// The strongest bin that `allowed`, where noise alone would hardly make it; 0 where there is none.
template <class Allowed>
std::size_t strongest(const std::vector<double>& power, Allowed&& allowed) {
  double sum = 0, best = 0;
  std::size_t count = 0, at = 0;
  for (std::size_t b = 1; b < power.size(); ++b) {
    if (!allowed(b)) continue;
    sum += power[b];
    ++count;
    if (power[b] > best) best = power[b], at = b;
  }
  if (count < 16) return 0;
  const double chance =
      static_cast<double>(count) * std::exp(-best * static_cast<double>(count) / sum);
  return chance < kFalse ? at : 0;
}

Candidate line(const Chain& chain, const char* key, double value) {
  Candidate candidate{.effect = make_placed(Traits::Place::kLine), .columns = {}};
  set_key(*candidate.effect, key, value);
  for (const Sampled& x : chain.columns(*candidate.effect))
    candidate.columns.push_back(chain.regressor(x));
  return candidate;
}

}  // namespace

std::vector<Candidate> strongest_lines(const Chain& chain, const Fit& fit) {
  std::vector<Candidate> lines;
  const Runs& runs = chain.sampler().torque();
  const Record& record = chain.equations().record();
  if (runs.row.size() < 256) return lines;
  std::vector<double> position(runs.row.size());
  // Time: one bin is half the resolution.
  {
    const double step = record.T_s * chain.sampler().decimation();
    const std::vector<double> t = times_of(runs, record);
    for (std::size_t n = 0; n < position.size(); ++n) position[n] = (t[n] - t.front()) / step;
    const std::size_t cells = power_of_two(2 * position.back());
    const double df = 1 / (step * static_cast<double>(cells));
    const std::size_t bin = strongest(spectrum(fit.y.torque, position, cells), [&](std::size_t b) {
      const double f = df * static_cast<double>(b);
      return f > kLowest_Hz && f < 0.42 / step;
    });
    if (bin > 0) lines.push_back(line(chain, "frequency_Hz", df * static_cast<double>(bin)));
  }
  // Angle.
  double lowest = 1e300, highest = -1e300;
  for (std::size_t row : runs.row) {
    lowest = std::min(lowest, record.theta_m[row]);
    highest = std::max(highest, record.theta_m[row]);
  }
  const double turns = (highest - lowest) / kTwoPi;
  if (turns > kFewestTurns && turns < 4000) {
    const std::size_t cells = power_of_two(4 * kHighestOrder * turns);
    const double cells_per_turn =
        std::min(8 * kHighestOrder, static_cast<double>(cells) / (2 * turns));
    for (std::size_t n = 0; n < position.size(); ++n)
      position[n] = (record.theta_m[runs.row[n]] - lowest) / kTwoPi * cells_per_turn;
    const double d_order = cells_per_turn / static_cast<double>(cells);
    const std::size_t bin = strongest(spectrum(fit.y.torque, position, cells), [&](std::size_t b) {
      const double order = d_order * static_cast<double>(b);
      return order > kLowestOrder && order < kHighestOrder &&
             std::abs(order - std::round(order)) > std::max(kWhole, 1.5 / turns);
    });
    if (bin > 0) lines.push_back(line(chain, "order", d_order * static_cast<double>(bin)));
  }
  return lines;
}

}  // namespace twinrate
