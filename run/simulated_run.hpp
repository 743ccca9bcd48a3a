// Simulated run: the closed loop in one process with the log of the process set in lock-step, bit
// for bit.
#pragma once
#include <string>

#include "loop/closed_loop.hpp"

namespace twinrate {

// Runs to the end or to a stop signal and writes DIR/log.lcm, with monitor.enabled
// DIR/monitor.json. Returns the cause of an early end; "" for a complete run. Throws
// std::runtime_error if the log cannot be created.
// `make`: the filter, that of the drive file or an own one.
std::string run_simulated(Config& config, const std::string& directory, bool json,
                          const MakeFilter& make = make_filter);

}  // namespace twinrate
