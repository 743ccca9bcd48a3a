// Lines in the torque residual that no whole order explains: periodic in time, or in the angle with
// a fractional order.
#pragma once
#include "trace/fit.hpp"

namespace twinrate {

// The strongest line of each sort in the fit's residual, as candidates (periodic_torque), whitened.
// Empty where none stands out of the noise.
std::vector<Candidate> strongest_lines(const Chain& chain, const Fit& fit);

}  // namespace twinrate
