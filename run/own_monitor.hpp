// The monitor in the process of a simulated run. It needs the tracer: a library of its own, so that
// a program without the tracer runs a drive too.
#pragma once
#include <memory>
#include <string>

#include "run/simulated_run.hpp"

namespace twinrate {

// Watches, traces and proposes effects, which the loop then knows. Writes DIRECTORY/monitor.json.
// Tracing takes no drive time.
std::unique_ptr<TickWatch> make_own_monitor(Config& config, ClosedLoop& loop,
                                            const std::string& directory,
                                            const PublishEvent& publish);

}  // namespace twinrate
