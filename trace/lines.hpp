// Lines in the torque residual that no candidate on a grid explains: periodic in time, periodic in
// the angle with a fractional order, or with a whole order above the grids.
#pragma once
#include "trace/fit.hpp"

namespace twinrate {

// The strongest line of each sort in the fit's residual, as whitened candidates: periodic_torque
// for the first two sorts, and every effect with an order of its own (cogging, flux_harmonics) for
// a whole order. Empty if no line exceeds the noise.
std::vector<Candidate> strongest_lines(const Chain& chain, const Fit& fit);

// The highest order that passes the sampler's low-pass, with more than two samples a period, in at
// least a twentieth of the rows, and with more than two counts of the encoder a period: an order of
// all counts is a constant at every reading.
double highest_order(const Chain& chain);

}  // namespace twinrate
