// The shape of a voltage drop over the current (model/effects/shapes.hpp). The candidates are clamped
// drops. A smooth drop, taken for a clamped one, leaves a residual that a second drop and a
// resistance follow.
#pragma once
#include "trace/acceptance.hpp"

namespace twinrate {

// `fit`, with another shape of each drop whose score is better by the margin.
Fit with_best_shapes(const Fitter& fitter, Fit fit, const Say& say);

}  // namespace twinrate
