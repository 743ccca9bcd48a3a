// Checked means runnable: what a run would build is built, and what theory says about it is said
// before the run.
#pragma once
#include <limits>
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

// Voltage error of R_s at 50 K above the temperature of the drive file, relative to R_s i.
inline constexpr double kResistanceError = 0.2;

// What a warning says about the run.
enum class Expects : int {
  kNothing,     // a fact of the drive file
  kLoss,        // a reason to expect a loss of synchronism
  kLossIfWarm,  // a loss where the winding is 50 K warmer than the drive file says
};
struct Warning {
  std::string text;  // one line: where, key, what
  Expects expects = Expects::kNothing;
  // A loss shows by then: that of a start. Infinite where only the whole run shows it.
  double shows_by_s = std::numeric_limits<double>::infinity();
};
std::vector<std::string> texts_of(const std::vector<Warning>& warnings);

// Builds filter, controller and plant as a run does (without the table of policy `scheduled`, which
// the trial of loop/trial_run.hpp builds). Throws BadInput, one line, for what cannot run:
//
//   keys that no chosen part reads (loop/unused_keys.hpp)
//   a filter or controller that the other settings do not allow
//   a start that the filter cannot make
//   gains of a state feedback that do not stabilise this machine
//
// Returns a warning for each demand beyond a limit (loop/demand.hpp) and for each reason to expect a
// loss of synchronism. loop/trial_run.hpp tries those reasons. Requires read_all_tables().
std::vector<Warning> check_runnable(Config& config);

}  // namespace twinrate
