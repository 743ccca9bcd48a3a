#include "trace/motion.hpp"

#include <algorithm>
#include <cmath>

#include "model/linear_algebra.hpp"

namespace twinrate {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double second_difference_at(const PositionLog& log, const std::vector<double>& x, double t,
                            double half) {
  return (value_at(log.t, x, t + half) - 2 * value_at(log.t, x, t) + value_at(log.t, x, t - half)) /
         (half * half);
}

bool turns_between(const PositionLog& log, const std::vector<int>& direction, double from,
                   double to) {
  const auto a = std::lower_bound(log.t.begin(), log.t.end(), from) - log.t.begin();
  const auto b = std::upper_bound(log.t.begin(), log.t.end(), to) - log.t.begin();
  return std::adjacent_find(direction.begin() + a, direction.begin() + b,
                            std::not_equal_to<int>()) != direction.begin() + b;
}

struct Windows {
  std::vector<double> alpha, current, direction, omega_m;
};

void add_windows(const PositionLog& log, double current_lag, Windows& w) {
  const double half = 30 * sample_interval(log);
  // The angle passes through the same filter as the current.
  const std::vector<double> angle = low_pass(log.t, log.theta_m, current_lag);
  const std::vector<double> i1 = running_integral(log.t, log.i_q);
  const std::vector<double> i2 = running_integral(log.t, i1);
  const std::vector<int> direction = directions(log);
  for (double t = log.t.front() + half; t < log.t.back() - half; t += half / 2) {
    if (turns_between(log, direction, t - half, t + half)) continue;
    const double omega_m =
        (value_at(log.t, angle, t + half) - value_at(log.t, angle, t - half)) / (2 * half);
    w.alpha.push_back(second_difference_at(log, angle, t, half));
    w.current.push_back(second_difference_at(log, i2, t, half));
    w.direction.push_back(omega_m > 0 ? 1 : -1);
    w.omega_m.push_back(omega_m);
  }
}

struct LinearFit {
  VectorXd x, sigma;
  double rest = 0;
};

LinearFit least_squares(const MatrixXd& A, const VectorXd& y) {
  LinearFit fit;
  fit.x = linear::least_squares(A, y);
  const VectorXd rest = y - A * fit.x;
  const double n = static_cast<double>(y.size());
  fit.rest = rest.norm() / std::sqrt(n);
  const double variance = rest.squaredNorm() / std::max(1.0, n - static_cast<double>(A.cols()));
  fit.sigma =
      (variance * linear::pseudo_inverse(A.transpose() * A)).diagonal().cwiseMax(0).cwiseSqrt();
  return fit;
}

}  // namespace

SpinUp fit_spin_up(std::span<const PositionLog* const> logs, const MachineParameters& machine,
                   double current_lag) {
  SpinUp spin;
  Windows w;
  for (const PositionLog* log : logs) add_windows(*log, current_lag, w);
  const auto n = static_cast<Index>(w.alpha.size());
  spin.windows = w.alpha.size();
  if (n < 30) return spin;
  const auto column = [n](const std::vector<double>& x) {
    return VectorXd(Eigen::Map<const VectorXd>(x.data(), n));
  };
  const VectorXd alpha = column(w.alpha), direction = column(w.direction);
  const bool both = std::abs(direction.mean()) < 0.9;
  MatrixXd A(n, both ? 4 : 3);
  A << column(w.current), -column(w.omega_m), VectorXd::Ones(n), MatrixXd(n, both ? 1 : 0);
  if (both) A.col(3) = -direction;
  const LinearFit fit = least_squares(A, alpha);
  spin.gain = fit.x[0];
  spin.sigma_gain = fit.sigma[0];
  const double J = machine.torque_constant() / spin.gain;
  spin.B = J * fit.x[1];
  spin.sigma_B = std::abs(J) * fit.sigma[1];
  if (both) {
    spin.T_C = J * fit.x[3];
    spin.sigma_T_C = std::abs(J) * fit.sigma[3];
  }
  spin.rest = fit.rest;
  spin.variation = std::sqrt((alpha.array() - alpha.mean()).square().mean());
  return spin;
}

namespace {

// Windows of a log for the comparison of its own speed with its angle.
class SpeedWindows {
 public:
  explicit SpeedWindows(const PositionLog& log)
      : log_(log), T_s_(sample_interval(log)), half_(4 * T_s_) {
    const std::vector<double> turned = running_integral(log.t, log.omega_m);
    std::vector<Window> all;
    for (double t = log.t.front() + 60 * T_s_; t < log.t.back() - 60 * T_s_; t += T_s_)
      all.push_back({t, (value_at(log.t, turned, t + half_) - value_at(log.t, turned, t - half_)) /
                            (2 * half_)});
    // The slowest windows: in them the jitter of the time stamps makes the least noise.
    const std::size_t count = std::min(all.size(), std::max<std::size_t>(all.size() / 16, 1000));
    std::sort(all.begin(), all.end(), [](const Window& a, const Window& b) {
      return std::abs(a.speed) < std::abs(b.speed);
    });
    all.resize(count);
    const std::size_t every = 1 + count / 3000;
    for (std::size_t k = 0; k < count; k += every) windows_.push_back(all[k]);
  }
  std::size_t size() const { return windows_.size(); }
  void set_filter(double filter) { angle_ = low_pass(log_.t, log_.theta_m, filter); }
  // Mean square of the difference, rad^2/s^2.
  double cost(double delay) const {
    double sum = 0;
    for (const Window& w : windows_) {
      const double error = w.speed - (value_at(log_.t, angle_, w.t + half_ - delay) -
                                      value_at(log_.t, angle_, w.t - half_ - delay)) /
                                         (2 * half_);
      sum += error * error;
    }
    return sum / static_cast<double>(windows_.size());
  }

 private:
  struct Window {
    double t, speed;
  };
  const PositionLog& log_;
  double T_s_, half_;
  std::vector<Window> windows_;
  std::vector<double> angle_;
};

}  // namespace

namespace {

// Sum of all lags: over a long window the change of the angle less the integral of the speed is the
// lag times the change of the speed, whatever the shape of the filter.
LinearFit whole_lag(const PositionLog& log) {
  const double half = 50 * sample_interval(log);
  const std::vector<double> turned = running_integral(log.t, log.omega_m);
  std::vector<double> missing, gained, sum;
  for (double t = log.t.front() + 2 * half; t < log.t.back() - 2 * half; t += half / 3) {
    const auto change = [&](const std::vector<double>& x) {
      return value_at(log.t, x, t + half) - value_at(log.t, x, t - half);
    };
    missing.push_back(change(log.theta_m) - change(turned));
    gained.push_back(change(log.omega_m));
    sum.push_back(change(turned));
  }
  const auto n = static_cast<Index>(missing.size());
  if (n < 10) return {};
  MatrixXd A(n, 2);
  A << Eigen::Map<const VectorXd>(gained.data(), n), Eigen::Map<const VectorXd>(sum.data(), n);
  return least_squares(A, Eigen::Map<const VectorXd>(missing.data(), n));
}

}  // namespace

SpeedLag fit_speed_lag(const PositionLog& log) {
  SpeedLag lag;
  if (log.omega_m.empty() || !log.has_time()) return lag;
  const LinearFit whole = whole_lag(log);
  SpeedWindows windows(log);
  if (windows.size() < 100 || whole.x.size() == 0) return lag;
  windows.set_filter(0);
  lag.rest = lag.rest_without = std::sqrt(windows.cost(0));
  if (whole.x[0] < 5 * whole.sigma[0]) return lag;
  lag.sigma = whole.sigma[0];
  // Splits the lag into a low-pass and a delay.
  for (int i = 0; i <= 20; ++i) {
    const double filter = whole.x[0] * i / 20;
    windows.set_filter(filter);
    const double rest = std::sqrt(windows.cost(whole.x[0] - filter));
    if (rest < lag.rest) lag.rest = rest, lag.filter = filter, lag.delay = whole.x[0] - filter;
  }
  return lag;
}

std::vector<double> step_means(const std::vector<double>& theta_m, int order, double phase) {
  std::vector<double> means(theta_m.size() > 1 ? theta_m.size() - 1 : 0);
  double angle = order * theta_m.front() + phase, c = std::cos(angle);
  for (std::size_t k = 0; k + 1 < theta_m.size(); ++k) {
    const double next = order * theta_m[k + 1] + phase, c_next = std::cos(next);
    const double turned = next - angle;
    means[k] = std::abs(turned) < 1e-4 ? std::sin(0.5 * (angle + next)) : (c - c_next) / turned;
    angle = next;
    c = c_next;
  }
  return means;
}

namespace {

// Speed gained since the first row by the model, behind the filter of the speed signal.
std::vector<double> speed_gained(const PositionLog& log, const MotionModel& model) {
  const std::size_t n = log.size();
  const double K_t = model.machine.torque_constant();
  std::vector<double> torque(n - 1, 0);  // Nm, mean over each step, opposing
  if (model.holding)
    for (const Harmonic& h : model.holding->cogging) {
      const std::vector<double> mean = step_means(log.theta_m, h.order, h.phase);
      for (std::size_t k = 0; k + 1 < n; ++k) torque[k] += h.amplitude * mean[k];
    }
  const std::vector<int> direction = directions(log);
  for (std::size_t k = 0; k + 1 < n; ++k)
    torque[k] += model.T_C * direction[k] +
                 model.B * (log.theta_m[k + 1] - log.theta_m[k]) / (log.t[k + 1] - log.t[k]);
  std::vector<double> gained(n, 0);
  for (std::size_t k = 0; k + 1 < n; ++k)
    gained[k + 1] = gained[k] + model.gain * (log.t[k + 1] - log.t[k]) *
                                    (0.5 * (log.i_q[k] + log.i_q[k + 1]) - torque[k] / K_t);
  return low_pass(log.t, gained, model.speed_lag.filter);
}

// Speed from the angle if the log has none: central difference over four steps to each side.
std::vector<double> measured_speed(const PositionLog& log) {
  if (!log.omega_m.empty()) return log.omega_m;
  std::vector<double> omega_m(log.size());
  const std::size_t last = log.size() - 1;
  for (std::size_t k = 0; k <= last; ++k) {
    const std::size_t a = k >= 4 ? k - 4 : 0, b = std::min(k + 4, last);
    omega_m[k] = (log.theta_m[b] - log.theta_m[a]) / (log.t[b] - log.t[a]);
  }
  return omega_m;
}

double mean_of(const std::vector<double>& x) {
  double sum = 0;
  for (const double value : x) sum += value;
  return x.empty() ? 0 : sum / static_cast<double>(x.size());
}

}  // namespace

SpeedChangeRows speed_change_rows(const PositionLog& log, const MotionModel& model,
                                  double horizon) {
  SpeedChangeRows rows;
  const std::vector<double> omega_m = measured_speed(log), gained = speed_gained(log, model);
  const double delay = model.speed_lag.delay, margin = 20 * sample_interval(log);
  for (const double t : log.t) {
    if (t < log.t.front() + margin || t + horizon > log.t.back() - margin) continue;
    rows.t.push_back(t);
    rows.measured.push_back(value_at(log.t, omega_m, t + horizon) - value_at(log.t, omega_m, t));
    rows.predicted.push_back(value_at(log.t, gained, t + horizon - delay) -
                             value_at(log.t, gained, t - delay));
  }
  return rows;
}

SpeedChange speed_change(const PositionLog& log, const MotionModel& model, double horizon) {
  const SpeedChangeRows rows = speed_change_rows(log, model, horizon);
  SpeedChange change;
  change.rows = rows.t.size();
  const double m = mean_of(rows.measured), p = mean_of(rows.predicted);
  for (std::size_t k = 0; k < rows.t.size(); ++k) {
    const double measured = rows.measured[k] - m, predicted = rows.predicted[k] - p;
    change.no_change += measured * measured;
    change.error += (measured - predicted) * (measured - predicted);
  }
  const double n = std::max<double>(1, static_cast<double>(change.rows));
  change.no_change = std::sqrt(change.no_change / n);
  change.error = std::sqrt(change.error / n);
  return change;
}

}  // namespace twinrate
