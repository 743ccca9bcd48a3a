// Filters for sampled signals: advance, smoothing and differentiation without a phase error in the
// tracer's band.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "model/frames.hpp"

namespace twinrate {

// The true signal of a reading that is late by `delay` behind a filter of time constant `tau`:
// true(t) = (reading + tau reading')(t + delay), by cubics through four samples; unchanged near the
// ends.
template <class Value>
std::vector<Value> ahead(const std::vector<Value>& reading, double delay, double tau, double T_s) {
  const auto n = static_cast<std::ptrdiff_t>(reading.size());
  std::vector<Value> before_filter = reading;
  for (std::ptrdiff_t k = 1; tau > 0 && k + 1 < n; ++k)
    before_filter[k] = reading[k] + tau / (2 * T_s) * (reading[k + 1] - reading[k - 1]);
  if (delay == 0) return before_filter;
  const double steps = std::floor(delay / T_s), f = delay / T_s - steps;
  const double w[] = {-f * (f - 1) * (f - 2) / 6, (f * f - 1) * (f - 2) / 2,
                      -f * (f + 1) * (f - 2) / 2, f * (f * f - 1) / 6};
  const auto shift = static_cast<std::ptrdiff_t>(steps);
  std::vector<Value> out = before_filter;
  for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, 1 - shift); k + shift + 2 < n; ++k) {
    const Value* x = &before_filter[k + shift];
    out[k] = w[0] * x[-1] + w[1] * x[0] + w[2] * x[1] + w[3] * x[2];
  }
  return out;
}

// Less noise and the same content within the tracer's band: a quadratic through eleven samples
// (Savitzky and Golay), or over the same time if each is the mean of `rows_each`. A non-linear
// effect, such as a dead time at small currents, would turn the noise into an offset.
std::vector<Vec2> smoothed(const std::vector<Vec2>& x, int rows_each = 1);
// Share of a sample in its own smoothed value; white noise keeps this share of its power.
double own_share(int rows_each = 1);
// Slope of a straight line through 21 samples, or over the same time; fewer near the ends.
std::vector<double> smooth_rate(const std::vector<double>& theta_m, double T_s, int rows_each = 1);

// Standard deviation of the white noise on a slow signal that is sampled fast, from its fourth
// difference at the rows of `use`.
template <class Value>
double white_noise(std::size_t n, Value&& value, const std::vector<char>& use) {
  std::vector<double> sizes;
  for (std::size_t k = 4; k < n; ++k)
    if (use[k] && use[k - 2] && use[k - 4])
      sizes.push_back(std::abs(value(k) - 4 * value(k - 1) + 6 * value(k - 2) - 4 * value(k - 3) +
                               value(k - 4)));
  if (sizes.empty()) return 0;
  const auto middle = sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  const double outlier = 6 * *middle;
  double sum = 0, count = 0;
  for (double size : sizes)
    if (size <= outlier) sum += size * size, ++count;
  return std::sqrt(sum / count / 70);
}

}  // namespace twinrate
