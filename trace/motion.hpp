// Findings from dynamic logs of angle and current: the acceleration by the current, the lag of the
// driver's speed signal, and the model's prediction of the speed.
#pragma once
#include <span>
#include <vector>

#include "trace/holding_torque.hpp"

namespace twinrate {

// alpha = (K_t/J) i_q - (T_C/J) direction - (B/J) omega_m, means under a triangle of thirty
// sampling intervals to each side (trace/position_log.hpp). Windows with a reversal are left out.
// Only ratios are identifiable: J is K_t of the machine over the gain found.
struct SpinUp {
  double gain = 0, sigma_gain = 0;  // K_t/J, rad/s^2 A; 0: no dynamic log
  double T_C = 0, sigma_T_C = 0, B = 0, sigma_B = 0;
  double rest = 0, variation = 0;  // of alpha, rad/s^2, rms: of the residual; about the mean
  std::size_t windows = 0;
};
SpinUp fit_spin_up(std::span<const PositionLog* const> logs, const MachineParameters& machine,
                   double current_lag = 0);

// The logged speed against the angle. Over short windows the integral of the speed is the change of
// the angle, `delay` earlier and behind a first-order low-pass of `filter`. Jitter of the time
// stamps makes noise in proportion to the speed. So only the slowest windows are used: a sixteenth
// of them, or 1000 if that is more.
struct SpeedLag {
  double delay = 0, filter = 0, sigma = 0;  // s; sigma of the sum
  double rest = 0, rest_without = 0;        // rad/s, rms
  double lag() const { return delay + filter; }
};
SpeedLag fit_speed_lag(const PositionLog& log);

// Known or traced parameters of the drive's motion.
struct MotionModel {
  double gain = 0;                         // K_t/J, rad/s^2 A
  const HoldingTorque* holding = nullptr;  // null: nothing found
  double T_C = 0, B = 0;                   // Nm, Nms
  SpeedLag speed_lag;                      // zero: none
  MachineParameters machine;
};

// Change of the speed over `horizon` in the log (its own speed, or that from the angle if it has
// none) less the prediction from current and angle; both less their means.
struct SpeedChange {
  double error = 0, no_change = 0;  // rad/s, rms
  std::size_t rows = 0;
};
SpeedChange speed_change(const PositionLog& log, const MotionModel& model, double horizon);
// The same row by row, for figures: t, measured, predicted.
struct SpeedChangeRows {
  std::vector<double> t, measured, predicted;
};
SpeedChangeRows speed_change_rows(const PositionLog& log, const MotionModel& model, double horizon);

// Mean of sin(order theta_m + phase) over each step between rows, with theta_m linear in between.
// So there is no aliasing, however many periods a step holds. One entry a step.
std::vector<double> step_means(const std::vector<double>& theta_m, int order, double phase);

}  // namespace twinrate
