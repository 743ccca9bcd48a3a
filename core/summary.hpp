// The figures of a run, over [settle_s, end] (docs/conventions.md says exactly how each is formed).
#pragma once
#include <cmath>
#include <map>
#include <optional>
#include <string>

#include "core/drive_config.hpp"
#include "core/run_log.hpp"

namespace twinrate {

struct Summary {
  // From the trajectories; those that need the truth are empty where there is none.
  std::optional<bool> locked;
  std::optional<double> speed_error_rms, angle_error_rms, angle_error_max;
  std::optional<double> speed_ripple_rms, speed_ripple_harmonics_rms;
  double duration_s = 0;
  std::int64_t steps = 0;
  std::int64_t gains_used = 0;    // distinct gains the fast loop ran on
  double P44_min = 0, P44_max = 0;  // angle variance of ekf_sensorless in the window; 0 for other filters
  // From the processes.
  std::map<std::string, std::int64_t> lost_messages;
  std::int64_t repeats = 0, deadline_misses = 0, late_gains = 0, late_commands = 0;
  double wall_s = 0;
};

Summary summarise(const RunLog& log, const DriveConfig& config);
std::string to_json(const Summary& summary, const DriveConfig& config);

// Electrical angle error wrap(theta_e_hat - theta_e) of each tick that has both, in (-pi, pi].
struct TickError {
  std::int64_t k;
  double t_s, angle_error, speed_error, omega_m;
};
std::vector<TickError> tick_errors(const RunLog& log, const DriveConfig& config);

}  // namespace twinrate
