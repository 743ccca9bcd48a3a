#include "trace/lines.hpp"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <unsupported/Eigen/FFT>
#include <utility>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/position_effects.hpp"

namespace twinrate {
namespace {

constexpr double kFalse = 1e-6;   // probability that noise alone makes such a line
constexpr double kLowest_Hz = 1;  // slower is drift
constexpr double kHighestOrder = 60, kLowestOrder = 0.3;  // of fractional orders
constexpr double kMostWhole = 2000;                       // the highest order of an effect
constexpr std::size_t kTurnCells = 8192;                  // of one turn: at least four a period
constexpr double kWhole = 0.06;  // of an order: closer is a whole order, cogging's if considered
constexpr double kFewestTurns = 4;
constexpr double kLongest_s = 2000;  // of a record with gaps

std::size_t power_of_two(double at_least) {
  std::size_t n = 1024;
  while (static_cast<double>(n) < at_least) n *= 2;
  return n;
}

// Times of the outputs. If logs with clocks of their own follow one another, or a long log has gaps
// so wide that the spectrum would take too much memory, the rows count as free of gaps.
std::vector<double> times_of(const Runs& runs, const Record& record) {
  std::vector<double> t;
  for (std::size_t row : runs.row) t.push_back(record.t[row]);
  if (std::is_sorted(t.begin(), t.end()) && t.back() - t.front() < kLongest_s) return t;
  for (std::size_t n = 0; n < t.size(); ++n) t[n] = static_cast<double>(runs.row[n]) * record.T_s;
  return t;
}

// Power by bin of y, spread onto an even grid of `position` (in cells).
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

struct Peak {
  std::size_t bin = 0;  // 0: none
  double chance = 1;    // number of such peaks that noise alone makes
};

// The strongest of the `allowed` bins.
template <class Allowed>
Peak strongest(const std::vector<double>& power, Allowed&& allowed) {
  double sum = 0, best = 0;
  std::size_t count = 0;
  Peak peak;
  for (std::size_t b = 1; b < power.size(); ++b) {
    if (!allowed(b)) continue;
    sum += power[b];
    ++count;
    if (power[b] > best) best = power[b], peak.bin = b;
  }
  const auto bins = static_cast<double>(count);
  if (sum > 0) peak.chance = bins * std::exp(-best * bins / sum);
  return peak;
}

// The same, if noise alone would hardly make it; 0: none.
template <class Allowed>
std::size_t strongest_line(const std::vector<double>& power, Allowed&& allowed) {
  const Peak peak = strongest(power, allowed);
  return peak.chance < kFalse ? peak.bin : 0;
}

Candidate with_columns(const Chain& chain, std::shared_ptr<Effect> effect) {
  Candidate candidate{.effect = std::move(effect), .columns = {}};
  for (const Sampled& x : chain.columns(*candidate.effect))
    candidate.columns.push_back(chain.regressor(x));
  return candidate;
}

void add_line(const Chain& chain, const char* key, double value, std::vector<Candidate>& lines) {
  const std::shared_ptr<Effect> effect = make_placed(Traits::Place::kLine);
  if (!chain.equations().considered()(effect->kind())) return;
  set_key(*effect, key, value);
  lines.push_back(with_columns(chain, effect));
}

// The first whole order above the grid of `effect`, and the step of the grid there; {0, 0}: no
// grid. A grid in multiples of n_p continues in multiples of n_p.
std::pair<double, double> beyond_grid(const Effect& effect) {
  const Traits traits = effect.tracing().traits();
  if (std::string_view(traits.period.order_key).empty() || traits.place != Traits::Place::kGrid ||
      traits.repeats.how != Traits::Repeats::kByKey)
    return {};
  for (const TracedKey& key : effect.tracing().traced_keys()) {
    if (std::string_view(key.key) != traits.period.order_key || key.grid.size() < 2) continue;
    const double last = key.grid.back(), step = last - key.grid[key.grid.size() - 2];
    return {last + step, step};
  }
  return {};
}

// Power of y at the whole orders, as a sum over both directions, because the whitening turns the
// phase of a line with the direction.
std::vector<double> order_power(const Eigen::VectorXd& y, const Runs& runs, const Record& record) {
  std::vector<double> power(kTurnCells / 2, 0.0);
  for (const bool forwards : {true, false}) {
    std::vector<double> position;
    std::vector<double> values;
    for (std::size_t n = 0; n < runs.row.size(); ++n) {
      const std::size_t row = runs.row[n];
      if (row + 1 >= record.size() || row == 0) continue;
      if ((record.theta_m[row + 1] > record.theta_m[row - 1]) != forwards) continue;
      const double turns = record.theta_m[row] / kTwoPi;
      position.push_back((turns - std::floor(turns)) * static_cast<double>(kTurnCells));
      values.push_back(y[static_cast<Eigen::Index>(n)]);
    }
    if (values.empty()) continue;
    const auto one_way = spectrum(
        Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size())),
        position, kTurnCells);
    for (std::size_t b = 0; b < power.size(); ++b) power[b] += one_way[b];
  }
  return power;
}

// Adds every effect at its strongest whole order above its grid. Its neighbours carry much of its
// power at changing speed, so the selection judges it, as it judges an order of the grid.
void add_whole_orders(const Chain& chain, const Fit& fit, std::vector<Candidate>& lines) {
  const double highest = highest_order(chain);
  std::vector<double> power;
  for (const std::string& kind : chain.equations().considered().kinds()) {
    const std::shared_ptr<Effect> effect = make_effect(kind);
    effect->prepare(chain.equations().facts());
    const auto [lowest, step] = beyond_grid(*effect);
    if (step <= 0 || highest < lowest) continue;
    if (power.empty())
      power = order_power(fit.y.torque, chain.sampler().torque(), chain.equations().record());
    const auto is_order = [&, first = lowest, by = step](std::size_t b) {
      const auto N = static_cast<double>(b);
      return N >= first && N <= highest && std::fmod(N - first, by) == 0;
    };
    const std::size_t order = strongest(power, is_order).bin;
    if (order == 0) continue;
    set_key(*effect, effect->tracing().traits().period.order_key, static_cast<double>(order));
    lines.push_back(with_columns(chain, effect));
  }
}

}  // namespace

double highest_order(const Chain& chain) {
  constexpr double kBand = 0.4;  // of the outputs' rate
  const Record& record = chain.equations().record();
  std::vector<double> step;  // turns from row to row
  for (std::size_t row : chain.sampler().torque().row)
    if (row > 0 && row + 1 < record.size())
      step.push_back(std::abs(record.theta_m[row + 1] - record.theta_m[row - 1]) / (2 * kTwoPi));
  if (step.empty()) return 0;
  const auto slow = step.begin() + static_cast<std::ptrdiff_t>(step.size() / 20);
  std::nth_element(step.begin(), slow, step.end());
  const double rate = kBand / chain.sampler().decimation();  // of a row's
  const double counts = kTwoPi / std::max(record.angle.lsb, 1e-12);
  return std::min({kMostWhole, (counts - 1) / 2, rate / std::max(*slow, 1e-12)});
}

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
    const std::size_t bin =
        strongest_line(spectrum(fit.y.torque, position, cells), [&](std::size_t b) {
          const double f = df * static_cast<double>(b);
          return f > kLowest_Hz && f < 0.42 / step;
        });
    if (bin > 0) add_line(chain, "frequency_Hz", df * static_cast<double>(bin), lines);
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
    const bool whole_too = !chain.equations().considered()(kOrderOfTorque);
    const double d_order = cells_per_turn / static_cast<double>(cells);
    const std::size_t bin =
        strongest_line(spectrum(fit.y.torque, position, cells), [&](std::size_t b) {
          const double order = d_order * static_cast<double>(b);
          return order > kLowestOrder && order < kHighestOrder &&
                 (whole_too || std::abs(order - std::round(order)) > std::max(kWhole, 1.5 / turns));
        });
    const double order = d_order * static_cast<double>(bin), whole = std::round(order);
    if (bin > 0) add_line(chain, "order", std::abs(order - whole) < kWhole ? whole : order, lines);
  }
  add_whole_orders(chain, fit, lines);
  return lines;
}

}  // namespace twinrate
