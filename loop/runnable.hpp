// Checked means runnable: what a run would build is built, and what theory says about it is said
// before the run.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

// Builds filter, controller and plant as a run does (without the table of policy `scheduled`, which
// takes seconds for a filter of many states). Throws BadInput, one line, for what cannot run:
//
//   keys that no chosen part reads (loop/unused_keys.hpp)
//   a filter or controller that the other settings do not allow
//   a start that the filter cannot make
//   gains of a state feedback that do not stabilise this machine
//
// Returns one line for each demand beyond a limit (loop/demand.hpp) and for each reason to expect a
// loss of synchronism. Requires read_all_tables().
std::vector<std::string> check_runnable(Config& config);

}  // namespace twinrate
