// Lines in the torque residual that no candidate on a grid explains: periodic in time, in the angle
// with a fractional order, or with a whole order above the grids.
#pragma once
#include "trace/fit.hpp"

namespace twinrate {

// The strongest line of each sort in the fit's residual, as candidates, whitened: periodic_torque,
// and every effect with an order of its own (cogging, flux_harmonics) at the whole order. Empty
// where none stands out of the noise.
std::vector<Candidate> strongest_lines(const Chain& chain, const Fit& fit);

}  // namespace twinrate
