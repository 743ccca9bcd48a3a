// Simulated run: the closed loop in one process with the log of the process set in lock-step, bit
// for bit.
#pragma once
#include <optional>
#include <string>

#include "analysis/long_log.hpp"
#include "loop/closed_loop.hpp"

namespace twinrate {

// Runs to the end or to a stop signal and writes DIR/log.lcm, with monitor.enabled
// DIR/monitor.json. Returns the cause of an early end; "" for a complete run. Throws
// std::runtime_error if the log cannot be created.
// `make`: the filter, that of the drive file or an own one. `kept`, if not null, gets the log
// without its messages of ticks, and run_ticks() of them, of a run of up to kTicksShown ticks.
std::string run_simulated(Config& config, const std::string& directory, bool json,
                          const MakeFilter& make = make_filter,
                          std::optional<LongLog>* kept = nullptr);

}  // namespace twinrate
