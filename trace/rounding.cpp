#include "trace/rounding.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace twinrate {
namespace {

constexpr double kNarrower = 0.0618;   // counts of the other encoder
constexpr std::ptrdiff_t kReach = 10;  // rows of the quadratic to either side

// Straight from one change of the reading to the next: half-way between two rows it is half-way
// between their readings.
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

// A quadratic through the rows around each (Savitzky and Golay); near the ends as it is.
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

}  // namespace

std::vector<double> between_readings(const std::vector<double>& readings, double lsb) {
  std::vector<double> path = smooth(joined(readings));
  for (std::size_t k = 0; k < path.size(); ++k)
    path[k] = std::clamp(path[k], readings[k] - lsb / 2, readings[k] + lsb / 2);
  return path;
}

std::vector<double> drawn_rounding(const std::vector<double>& readings, double lsb) {
  std::vector<double> errors = between_readings(readings, lsb);
  for (double& x : errors) {
    const double phi = (1 + kNarrower) * x / lsb;
    x = (std::floor(phi) + 0.5 - phi) * lsb;
  }
  return errors;
}

}  // namespace twinrate
