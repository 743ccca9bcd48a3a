// What dynamic logs of angle and current say: how much the current accelerates, how late the
// driver's speed is, and what a model predicts of the speed.
#pragma once
#include <span>
#include <vector>

#include "trace/holding_torque.hpp"

namespace twinrate {

// alpha = (K_t/J) i_q - (T_C/J) direction - (B/J) omega_m, means under a triangle of thirty
// sampling intervals to each side (trace/position_log.hpp); windows in which the motion turns are
// left out. Only ratios show: J stands for K_t of the machine over what was found.
struct SpinUp {
  double gain = 0, sigma_gain = 0;  // K_t/J, rad/s^2 A; 0: no dynamic log
  double T_C = 0, sigma_T_C = 0, B = 0, sigma_B = 0;
  double rest = 0, variation = 0;  // rad/s^2, rms
  std::size_t windows = 0;
};
SpinUp fit_spin_up(std::span<const PositionLog* const> logs, const MachineParameters& machine,
                   double current_lag = 0);

// The logged speed against the angle: over short windows the integral of the one is the change of
// the other, `delay` earlier and behind a first-order low-pass of `filter`. Jitter of the time
// stamps makes noise in proportion to the speed, so the slowest sixteenth of the windows decides,
// or the slowest 1000.
struct SpeedLag {
  double delay = 0, filter = 0, sigma = 0;  // s; sigma of the sum
  double rest = 0, rest_without = 0;        // rad/s, rms
  double lag() const { return delay + filter; }
};
SpeedLag fit_speed_lag(const PositionLog& log);

// What is known of the drive, or was found.
struct MotionModel {
  double gain = 0;                         // K_t/J, rad/s^2 A
  const HoldingTorque* holding = nullptr;  // null: nothing found
  double T_C = 0, B = 0;                   // Nm, Nms
  SpeedLag speed_lag;                      // zero: none
  MachineParameters machine;
};

// Change of the speed over `horizon` as the log shows it (its own speed, or the angle's where it
// has none) less the prediction from current and angle; both less their means.
struct SpeedChange {
  double error = 0, no_change = 0;  // rad/s, rms
  std::size_t rows = 0;
};
SpeedChange speed_change(const PositionLog& log, const MotionModel& model, double horizon);
// The same, row by row, for figures: t, measured, predicted.
struct SpeedChangeRows {
  std::vector<double> t, measured, predicted;
};
SpeedChangeRows speed_change_rows(const PositionLog& log, const MotionModel& model, double horizon);

// Mean of sin(order theta_m + phase) over each step between rows, theta_m linear in between: no
// aliasing however many periods a step holds. One entry a step.
std::vector<double> step_means(const std::vector<double>& theta_m, int order, double phase);

}  // namespace twinrate
