// The shape of a voltage drop over the current (model/effects/shapes.hpp). The candidates are clamped
// drops. A smooth drop, taken for a clamped one, leaves a residual that a second drop and a
// resistance follow.
#pragma once
#include "trace/acceptance.hpp"

namespace twinrate {

// `fit`, or the best fit with another shape of its last member if its score is better by the
// margin and its held-out error is not larger.
// Not asked again beside later effects: a resistance beside a clamped drop of a log of every 10th
// tick was then a smooth drop, and the gate refused both.
Fit with_best_shape(const Fitter& fitter, Fit fit, const Say& say);

}  // namespace twinrate
