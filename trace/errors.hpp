// The errors of the equations before and after, on training and held-out rows, and the residuals
// themselves for pictures.
#pragma once
#include "trace/fit.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Fills `r`: electrical, mechanical, their series and which of the two is the main one.
void compare_errors(const Fitter& fitter, const Fit& fit, TraceResult& r);

}  // namespace twinrate
