// The structure of the residual after the selection, and the run that separates two causes.
#pragma once
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

// Binned means of the whitened residual over current, speed, angle, time and direction that are
// larger than noise.
std::vector<Structure> residual_structure(const Fitter& fitter, const Fit& fit);
// A line (periodic_torque) that the selection needed.
Structure line_structure(const Effect& effect, const Selected& selected);
// The run that separates the kinds, in words.
std::string what_separates(const std::vector<std::string>& kinds);
// The same where no profile of speed, load and current does; empty: one may.
std::string beyond_a_run(const std::vector<std::string>& kinds);

}  // namespace twinrate
