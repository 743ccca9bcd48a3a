// The check before a run: builds the parts of the run, and reports the predictions of theory about
// it.
#pragma once
#include <limits>
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

// Voltage error of R_s at 50 K above the temperature of the drive file, relative to R_s i.
inline constexpr double kResistanceError = 0.2;

// The meaning of a warning for the run.
enum class Expects : int {
  kNothing,     // a fact of the drive file
  kLoss,        // a reason to expect a loss of synchronism
  kLossIfWarm,  // a loss if the winding is 50 K warmer than in the drive file
};
struct Warning {
  std::string text;  // one line: place, key, problem
  Expects expects = Expects::kNothing;
  // Time by which a loss is visible: that of a start. Infinite if only the whole run shows it.
  double shows_by_s = std::numeric_limits<double>::infinity();
};
std::vector<std::string> texts_of(const std::vector<Warning>& warnings);

// Builds filter, controller and plant as a run does (without the table of policy `scheduled`, which
// the trial of loop/trial_run.hpp builds). Throws BadInput, one line, if the run is impossible:
//
//   keys that no chosen part reads (loop/unused_keys.hpp)
//   a filter or controller that the other settings do not allow
//   a start that the filter cannot make
//   gains of a state feedback that do not stabilise this machine
//
// Returns a warning for each demand beyond a limit (loop/demand.hpp) and for each reason to expect a
// loss of synchronism. loop/trial_run.hpp tries those reasons. Requires read_all_tables().
std::vector<Warning> check_runnable(Config& config);

// Time of the start of `align_if` until the hand-over to the estimate, s: alignment, ramp and
// agreement. 0 for other starts. Requires read_all_tables().
double start_takes_s(Config& config);

}  // namespace twinrate
