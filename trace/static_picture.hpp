// Pictures of a set without time: the residual of each channel with the constants alone, and with
// the traced effects.
#pragma once
#include "trace/result.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {

// One a channel: an inverter curve over the current of its phase (with the curve itself), a flux
// map over the current of the axis.
std::vector<TracePicture> static_pictures(const StaticTrace& trace, StaticKind kind);

}  // namespace twinrate
