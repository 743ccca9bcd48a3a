// The gate (trace/point_gate.hpp) of a static set, and the part of it that no effect explains.
#pragma once
#include "trace/static_selection.hpp"

namespace twinrate {

// Removes the refused terms from `selection`, the weakest first, and fits the others again to all
// points that do not judge. Constants are claims like all others.
void pass_gate(const StaticProblem& problem, StaticSelection& selection);

}  // namespace twinrate
