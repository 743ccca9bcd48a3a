// Response of the speed to each step of the drive file's reference and load.
//
//   rise       of a step of the speed: from its first passage of 10 % to that of 90 %
//   overshoot  largest excess: beyond a step of the speed; over the reference after one of the load
//   dip        of a step of the load: largest shortfall from the reference
//   recovery   from the step until the speed stays within 2 % of the step of the speed, or within
//              a tenth of the largest deviation after a step of the load; empty unless it then stays
//              there for at least as long as it took
//
// A step is judged until the next one or the end of the log. The first value of the reference is a
// step from the speed at the first tick. For a step of the load, excess and shortfall count in the
// direction of the reference. The figures include a slew limit of the drive file and any ripple of
// the speed.
#pragma once
#include <optional>
#include <vector>

#include "analysis/tick_rows.hpp"
#include "core/drive_config.hpp"

namespace twinrate {

struct StepResponse {
  bool of_load = false;
  double t_s = 0;           // from the first tick
  double from = 0, to = 0;  // rad/s mechanical, or Nm
  double reference = 0;     // rad/s mechanical, of the reference at the step of a load
  std::optional<double> rise_s, overshoot, dip, recovery_s;  // s, rad/s
};

// omega_m[i] of rows[i], as reference_speed() has it; NaN where it is not known.
std::vector<StepResponse> step_responses(TickRows rows, const std::vector<double>& omega_m,
                                         const DriveConfig& config);

}  // namespace twinrate
