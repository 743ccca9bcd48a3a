// The gate (trace/point_gate.hpp) of a static set, and what no effect explains of it.
#pragma once
#include "trace/static_selection.hpp"

namespace twinrate {

// Takes from `selection` what does not pass, the weakest first, and fits the others anew to all
// points that do not judge. Constants are claims as all others.
void pass_gate(const StaticProblem& problem, StaticSelection& selection);

}  // namespace twinrate
