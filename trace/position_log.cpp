#include "trace/position_log.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "model/frames.hpp"

namespace twinrate {
namespace {

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double deviation(const std::vector<double>& values) {
  if (values.empty()) return 0;
  const double n = static_cast<double>(values.size());
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double sum = 0;
  for (const double value : values) sum += (value - mean) * (value - mean);
  return std::sqrt(sum / n);
}

// True if for a quarter of the time the rotor is so fast that its momentum carries it through a
// period of the cogging even against the whole torque in the log. At such a steady speed nothing
// accelerates, and yet the current does not hold the rotor.
bool momentum_carries(const PositionLog& log, double half, double torque,
                      const MachineParameters& machine) {
  constexpr double kShare = 0.25;
  std::vector<double> speed;
  double last = log.t.front() - half;
  for (const double t : log.t) {
    if (t < last + half || t > log.t.back() - half) continue;
    last = t;
    speed.push_back(
        std::abs(value_at(log.t, log.theta_m, t + half) - value_at(log.t, log.theta_m, t)) / half);
  }
  if (speed.empty()) return false;
  const auto fast = speed.begin() + static_cast<std::ptrdiff_t>(
                                        (1 - kShare) * static_cast<double>(speed.size() - 1));
  std::nth_element(speed.begin(), fast, speed.end());
  const double period = kTwoPi / (6 * machine.n_p);
  return 0.5 * machine.J * *fast * *fast > torque * period;
}

}  // namespace

double sample_interval(const PositionLog& log) {
  std::vector<double> steps;
  for (std::size_t k = 1; k < log.t.size(); ++k) steps.push_back(log.t[k] - log.t[k - 1]);
  return median(std::move(steps));
}

double row_noise(const std::vector<double>& x) {
  std::vector<double> third;
  for (std::size_t k = 3; k < x.size(); ++k)
    third.push_back(std::abs(x[k] - 3 * x[k - 1] + 3 * x[k - 2] - x[k - 3]));
  // Median of |x| of a normal x is 0.6745 sigma; the weights' squares sum to 20.
  return median(std::move(third)) / 0.6745 / std::sqrt(20.0);
}

double angle_noise(const PositionLog& log) {
  return row_noise(log.theta_m);
}

std::vector<int> directions(const PositionLog& log, double backlash) {
  std::vector<int> direction(log.size(), 1);
  if (log.size() < 2) return direction;
  if (backlash <= 0) {
    const auto [low, high] = std::minmax_element(log.theta_m.begin(), log.theta_m.end());
    backlash = std::min(10 * angle_noise(log), 0.02 * (*high - *low));
  }
  // An excursion of `backlash` from the extreme reverses the direction, from that extreme's row on.
  int now = 0;
  std::size_t lowest = 0, highest = 0, extreme = 0;
  const auto& theta_m = log.theta_m;
  for (std::size_t k = 1; k < log.size(); ++k) {
    if (now == 0) {
      if (theta_m[k] < theta_m[lowest]) lowest = k;
      if (theta_m[k] > theta_m[highest]) highest = k;
      if (theta_m[k] - theta_m[lowest] > backlash) now = 1;
      if (theta_m[highest] - theta_m[k] > backlash) now = -1;
      if (now != 0) {
        std::fill(direction.begin(), direction.begin() + static_cast<std::ptrdiff_t>(k), now);
        extreme = k;
      }
    } else if (now * (theta_m[k] - theta_m[extreme]) >= 0) {
      extreme = k;
    } else if (now * (theta_m[extreme] - theta_m[k]) > backlash) {
      now = -now;
      for (std::size_t j = extreme + 1; j < k; ++j) direction[j] = now;
      extreme = k;
    }
    direction[k] = now == 0 ? 1 : now;
  }
  return direction;
}

std::vector<double> running_integral(const std::vector<double>& t, const std::vector<double>& x) {
  std::vector<double> sum(x.size(), 0);
  for (std::size_t k = 1; k < x.size(); ++k)
    sum[k] = sum[k - 1] + 0.5 * (x[k] + x[k - 1]) * (t[k] - t[k - 1]);
  return sum;
}

double value_at(const std::vector<double>& t, const std::vector<double>& x, double when) {
  if (when <= t.front()) return x.front();
  if (when >= t.back()) return x.back();
  const auto after =
      static_cast<std::size_t>(std::upper_bound(t.begin(), t.end(), when) - t.begin());
  const double share = (when - t[after - 1]) / (t[after] - t[after - 1]);
  return x[after - 1] + share * (x[after] - x[after - 1]);
}

std::vector<double> low_pass(const std::vector<double>& t, const std::vector<double>& x,
                             double tau) {
  if (tau <= 0 || x.empty()) return x;
  std::vector<double> y(x.size());
  y[0] = x[0];
  for (std::size_t k = 1; k < x.size(); ++k) {
    const double h = t[k] - t[k - 1], a = std::exp(-h / tau), q = tau * (1 - a) / h;
    y[k] = a * y[k - 1] + (q - a) * x[k - 1] + (1 - q) * x[k];
  }
  return y;
}

Acceleration second_difference(const PositionLog& log, double half) {
  Acceleration a;
  a.half = half;
  double last = log.t.empty() ? 0 : log.t.front() + half / 2;
  for (const double t : log.t) {
    if (t < last + half / 2 || t < log.t.front() + half || t > log.t.back() - half) continue;
    last = t;
    a.t.push_back(t);
    a.acceleration.push_back((value_at(log.t, log.theta_m, t + half) -
                              2 * value_at(log.t, log.theta_m, t) +
                              value_at(log.t, log.theta_m, t - half)) /
                             (half * half));
  }
  return a;
}

bool is_quasi_static(const PositionLog& log, const MachineParameters& machine) {
  if (!log.has_time()) return true;
  const double torque = machine.torque_constant() * deviation(log.i_q);
  // Long enough that the noise of the angle makes only a negligible acceleration.
  const double half = std::max(
      5 * sample_interval(log),
      std::sqrt(machine.J * std::sqrt(6.0) * angle_noise(log) / std::max(0.1 * torque, 1e-12)));
  if (momentum_carries(log, half, torque, machine)) return false;
  Acceleration a = second_difference(log, half);
  for (double& value : a.acceleration) value = std::abs(value);
  // A robust measure: a single jump between two rests does not make a log dynamic.
  return machine.J * median(std::move(a.acceleration)) / 0.6745 < 0.25 * torque;
}

bool is_drive_log(const PositionLog& log, const MachineParameters& machine) {
  return log.has_time() && !is_quasi_static(log, machine);
}

std::size_t judged_length(const PositionLog& log) {
  return std::max<std::size_t>(1, log.size() / 3000);
}

std::vector<char> holding_rows(const PositionLog& log, double memory) {
  std::vector<char> ok(log.size(), 1);
  if (!log.has_time()) return ok;
  std::vector<double> speed(log.size(), 0);
  const std::size_t reach = 5;
  for (std::size_t k = 0; k < log.size(); ++k) {
    const std::size_t a = k >= reach ? k - reach : 0, b = std::min(k + reach, log.size() - 1);
    speed[k] = std::abs(log.theta_m[b] - log.theta_m[a]) / (log.t[b] - log.t[a]);
  }
  // In a log that rests most of the time the median is nearly zero, so the mean is used.
  const double mean =
      std::accumulate(speed.begin(), speed.end(), 0.0) / static_cast<double>(speed.size());
  const double fastest = 5 * std::max(median(speed), mean);
  double until = log.t.front() + memory;
  for (std::size_t k = 0; k < log.size(); ++k) {
    if (speed[k] > fastest) until = log.t[k] + memory;
    ok[k] = log.t[k] > until || (memory == 0 && speed[k] <= fastest);
  }
  return ok;
}

std::vector<char> holding_rows(const PositionLog& log, double memory, bool judge) {
  std::vector<char> ok = holding_rows(log, memory);
  for (std::size_t k = 0; k < ok.size(); ++k) {
    const bool judges = log.judges.empty() ? log.held_out : log.judges[k] != 0;
    ok[k] = ok[k] && judges == judge;
  }
  return ok;
}

}  // namespace twinrate
