// The drive file with what a trace found added to it: every program can use it.
#pragma once
#include <string>

#include "core/config.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Traced effects stand in it as used_in = "both", in the place of the plant's own effects that the
// model did not know (a simulated plant's secret); `keep_plant`: those stay, and the traced ones
// are "model" only.
std::string extended_toml(const Config& config, const TraceResult& result, bool keep_plant);

}  // namespace twinrate
