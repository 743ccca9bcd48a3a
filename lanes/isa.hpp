// The engine's translation units, one for each instruction set.
#pragma once
#include "lanes/runner.hpp"

namespace twinrate::lanes {

using RunLanes = void(const LaneSettings&, const LaneConstants<double>&, Policy, const LaneQueue&);
RunLanes run_portable, run_scalar, run_avx2, run_avx512;

}  // namespace twinrate::lanes
