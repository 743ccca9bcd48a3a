// The drive file extended by the traced effects; every program can use it.
#pragma once
#include <string>

#include "core/config.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Traced effects have used_in = "both" and replace the plant's own effects that the model did not
// know (a simulated plant's secret). With `keep_plant` the latter stay, and the traced effects have
// used_in = "model".
std::string extended_toml(const Config& config, const TraceResult& result, bool keep_plant);

}  // namespace twinrate
