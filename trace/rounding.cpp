#include "trace/rounding.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace twinrate {
namespace {

constexpr double kNarrower = 0.0618;  // counts of the other encoder
constexpr double kMoved = 0.2113;     // of a count; saw teeth this far apart are uncorrelated
constexpr std::ptrdiff_t kReach = 10, kLongestReach = 320;  // rows of a quadratic to either side
constexpr double kWithin = 0.55;  // counts from a reading's centre: its cell and a tenth of it

// Straight lines from one change of the reading to the next: halfway between two rows the path is
// halfway between their readings.
std::vector<double> joined(const std::vector<double>& readings) {
  std::vector<double> path = readings;
  std::ptrdiff_t last = -1;  // the row before the last change
  double from = 0;
  for (std::size_t k = 1; k < readings.size(); ++k) {
    if (readings[k] == readings[k - 1]) continue;
    const double to = (readings[k - 1] + readings[k]) / 2;
    const auto row = static_cast<std::ptrdiff_t>(k) - 1;
    for (std::ptrdiff_t j = last + 1; last >= 0 && j <= row; ++j) {
      const double share = (static_cast<double>(j - last) - 0.5) / static_cast<double>(row - last);
      path[static_cast<std::size_t>(j)] = from + share * (to - from);
    }
    last = row;
    from = to;
  }
  return path;
}

// A quadratic through the rows around each row (Savitzky and Golay); unchanged near the ends.
std::vector<double> smooth(const std::vector<double>& x) {
  const double m = kReach;
  std::vector<double> weight;
  for (std::ptrdiff_t j = 0; j <= kReach; ++j)
    weight.push_back(3 * (3 * m * m + 3 * m - 1 - 5 * static_cast<double>(j * j)) /
                     ((2 * m - 1) * (2 * m + 1) * (2 * m + 3)));
  std::vector<double> out = x;
  const auto n = static_cast<std::ptrdiff_t>(x.size());
  for (std::ptrdiff_t k = kReach; k + kReach < n; ++k) {
    const double* at = x.data() + k;
    double sum = weight[0] * at[0];
    for (std::ptrdiff_t j = 1; j <= kReach; ++j)
      sum += weight[static_cast<std::size_t>(j)] * (at[-j] + at[j]);
    out[static_cast<std::size_t>(k)] = sum;
  }
  return out;
}

// Least squares over the rows around one row: value, slope and half the curvature there.
struct Quadratic {
  double value, slope, bend;
  double at(double rows) const { return value + (slope + bend * rows) * rows; }
};

Quadratic fitted(const double* at, std::ptrdiff_t reach) {
  const double m = static_cast<double>(reach), n = 2 * m + 1, squares = m * (m + 1) * n / 3,
               mean = squares / n, fourths = squares * (3 * m * m + 3 * m - 1) / 5,
               spread = fourths - mean * squares;
  double sum = 0, slope = 0, bend = 0;
  for (std::ptrdiff_t j = -reach; j <= reach; ++j) {
    const double row = static_cast<double>(j), x = at[j] - at[0];
    sum += x, slope += row * x, bend += (row * row - mean) * x;
  }
  const double curved = bend / spread;
  return {at[0] + sum / n - curved * mean, slope / squares, curved};
}

// The shaft moves smoothly, and each reading limits it to a cell. The best estimate is the longest
// window whose quadratic stays within the cells of all its readings. If the readings step by nearly
// the same amount from row to row, only a long window shows the position in the cell.
struct Path {
  std::vector<double> theta;
  std::vector<char> known;  // to less than a cell
};

Path path_between(const std::vector<double>& readings, double lsb) {
  Path path{joined(readings), std::vector<char>(readings.size(), 0)};
  const std::vector<double> straight = path.theta;
  std::vector<char> longer(readings.size(), 1);  // true while a longer window may fit
  const auto n = static_cast<std::ptrdiff_t>(readings.size());
  for (std::ptrdiff_t reach = kReach; reach <= kLongestReach; reach *= 2) {
    const std::ptrdiff_t half = reach / (2 * kReach);  // rows to either side that use one window
    for (std::ptrdiff_t k = reach; k + reach < n; k += 2 * half + 1) {
      if (!longer[static_cast<std::size_t>(k)]) continue;
      const Quadratic q = fitted(straight.data() + k, reach);
      const double* reading = readings.data() + k;
      bool within = true;
      for (std::ptrdiff_t j = -reach; within && j <= reach; ++j)
        within = std::abs(reading[j] - q.at(static_cast<double>(j))) < kWithin * lsb;
      for (std::ptrdiff_t j = -half; j <= half; ++j) {
        const auto row = static_cast<std::size_t>(k + j);
        longer[row] = within;
        if (!within && reach > kReach) continue;
        path.theta[row] = q.at(static_cast<double>(j));
        path.known[row] = within;
      }
    }
  }
  for (std::size_t k = 0; k < readings.size(); ++k)
    path.theta[k] = std::clamp(path.theta[k], readings[k] - lsb / 2, readings[k] + lsb / 2);
  return path;
}

double rounding_of(double counts, double lsb) {
  return (std::floor(counts) + 0.5 - counts) * lsb;
}

}  // namespace

std::vector<double> between_readings(const std::vector<double>& readings, double lsb) {
  std::vector<double> path = smooth(joined(readings));
  for (std::size_t k = 0; k < path.size(); ++k)
    path[k] = std::clamp(path[k], readings[k] - lsb / 2, readings[k] + lsb / 2);
  return path;
}

std::vector<double> drawn_rounding(const std::vector<double>& readings, double lsb) {
  std::vector<double> errors = between_readings(readings, lsb);
  for (double& x : errors) x = rounding_of((1 + kNarrower) * x / lsb, lsb);
  return errors;
}

std::vector<double> moved_rounding(const std::vector<double>& readings, double lsb) {
  const Path path = path_between(readings, lsb);
  std::vector<double> errors = path.theta;
  for (std::size_t k = 0; k < errors.size(); ++k) {
    const double counts = errors[k] / lsb;
    errors[k] = rounding_of(path.known[k] ? counts + kMoved : (1 + kNarrower) * counts, lsb);
  }
  return errors;
}

}  // namespace twinrate
