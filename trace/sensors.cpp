#include "trace/sensors.hpp"

#include <algorithm>
#include <cmath>
#include <complex>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr double kUnit = 1e-7;          // rad, closer readings are equal
constexpr double kSame = 2e-6;          // rad, change of a reading by six digits or more
constexpr double kFewDigits = 4;        // a shorter step is made by the digits of the file
constexpr double kDigits = 1.5;         // last digits, change of a reading in all turns
constexpr double kFinest = 2.3e-5;      // rad, step of 2^18 counts
constexpr std::size_t kMost = 1 << 18;  // readings of a counter within a turn, with kSame
constexpr std::size_t kFewest = 24;
constexpr double kOnGrid = 0.95;  // of 1, mean of the unit vectors of readings over the step
constexpr double kBends = 0.1;    // share of the moving rows whose step differs from the last one
constexpr std::size_t kFewestBends = 10, kMostBends = 1000;
constexpr std::size_t kWindow = 64, kFewestWindows = 10, kMostWindows = 1 << 16;

std::complex<double> mean_phase(const std::vector<double>& readings, double step) {
  std::complex<double> sum = 0;
  for (double x : readings) sum += std::polar(1.0, kTwoPi * x / step);
  return sum / static_cast<double>(readings.size());
}

// The common step of all readings, from the smallest distance of two readings. Each longer distance
// makes it more exact.
double common_step(const std::vector<double>& sorted) {
  double step = kTwoPi;
  for (std::size_t k = 1; k < sorted.size(); ++k) step = std::min(step, sorted[k] - sorted[k - 1]);
  for (double x : sorted)
    if (const double steps = std::round((x - sorted.front()) / step); steps > 0)
      step = (x - sorted.front()) / steps;
  return step;
}

// The way from row to row changes by whole steps, and often by less than half of itself.
bool slips_by_steps(const std::vector<double>& bends, double step, double mean_way, double same) {
  const auto whole = [step, same](double bend) {
    return std::abs(std::remainder(bend, step)) < 2 * same;
  };
  const auto slip = [mean_way](double bend) { return std::abs(bend) < mean_way / 2; };
  return std::all_of(bends.begin(), bends.end(), whole) &&
         std::count_if(bends.begin(), bends.end(), slip) >=
             static_cast<std::ptrdiff_t>(kFewestBends);
}

// True if the mean way of a row is no whole number of steps in some windows. Without counts their
// readings would lie between the steps.
bool moves_by_parts(const std::vector<double>& ways, double step) {
  constexpr double kWhole = 0.1;  // of a row's way, a step at least: six lost rows of a window
  return std::count_if(ways.begin(), ways.end(), [step](double way) {
           const double of_row = way / static_cast<double>(kWindow);
           return std::abs(std::remainder(of_row, step)) >
                  kWhole * std::max(step, std::abs(of_row));
         }) >= static_cast<std::ptrdiff_t>(kFewestWindows);
}

}  // namespace

int Sensor::counts() const {
  return lsb > 0 ? static_cast<int>(std::lround(kTwoPi / lsb)) : 0;
}

void AngleSteps::add(double theta_m) {
  decimals_.add(theta_m);
  if (last_ && before_ && theta_m != *last_) {
    ++moves_;
    way_ += std::abs(std::remainder(theta_m - *last_, kTwoPi));
    if (const double bend = std::remainder(theta_m - 2 * *last_ + *before_, kTwoPi);
        std::abs(bend) > kFinest / 2) {
      ++bends_;
      if (first_bends_.size() < kMostBends) first_bends_.push_back(bend);
    }
  }
  if (last_) way_of_window_ += std::remainder(theta_m - *last_, kTwoPi);
  if (++rows_of_window_ == kWindow) {
    if (ways_.size() < kMostWindows) ways_.push_back(way_of_window_);
    way_of_window_ = 0, rows_of_window_ = 0;
  }
  before_ = last_;
  last_ = theta_m;
  if (!few_) return;
  const double within = theta_m - kTwoPi * std::floor(theta_m / kTwoPi);
  readings_.insert(std::llround(within / kUnit));
  few_ = readings_.size() <= kMost;
  if (!few_) readings_.clear();
}

namespace {

Sensor counter(double step, const std::complex<double>& phase) {
  // Readings at half a step come from a driver that has centred them.
  constexpr double kNear = 0.02;
  const double low = std::arg(phase) / kTwoPi;
  return {.lsb = step, .centre = std::abs(std::abs(low) - 0.5) < kNear ? 0 : step / 2};
}

}  // namespace

Sensor AngleSteps::sensor() const {
  if (!few_) return {};
  std::vector<long long> keys(readings_.begin(), readings_.end());
  std::sort(keys.begin(), keys.end());
  const double digit = decimals_.digit(), same = std::max(kSame, kDigits * digit);
  std::vector<double> readings;
  for (long long key : keys)
    if (const double x = kUnit * static_cast<double>(key);
        readings.empty() || x - readings.back() > same)
      readings.push_back(x);
  if (readings.size() < kFewest) return {};
  const Sensor found = found_in(readings, same);
  // Steps of few digits are the digits themselves, to which a file rounds to the nearest.
  if (found.lsb > 0 && found.lsb < kFewDigits * digit) return {.lsb = digit, .centre = 0};
  if (found.lsb > 0 || declared_ <= 0) return found;
  const double step = kTwoPi / declared_;
  const std::complex<double> phase = mean_phase(readings, step);
  return step < kFinest || std::abs(phase) < kOnGrid ? Sensor{} : counter(step, phase);
}

Sensor AngleSteps::found_in(const std::vector<double>& readings, double same) const {
  const double counts = kTwoPi / common_step(readings), whole = std::round(counts);
  const double step = kTwoPi / whole;
  if (step < kFinest) return {};
  const std::complex<double> phase = mean_phase(readings, step);
  if (std::abs(phase) < kOnGrid) return {};
  // A rotor at the speed of a clock has equal steps from row to row, even without counts; with counts a step
  // sometimes differs by a few of them. A deviation by a whole row's step is a repeated row.
  const double moves = static_cast<double>(moves_);
  if (static_cast<double>(bends_) < kBends * moves && !moves_by_parts(ways_, step) &&
      (1.5 * step > way_ / moves || !slips_by_steps(first_bends_, step, way_ / moves, same)))
    return {};
  return counter(step, phase);
}

}  // namespace twinrate
