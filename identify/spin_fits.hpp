// Flux linkage and motion of a spun motor (spin.hpp has the equations), by least squares over segments.
#pragma once
#include <vector>

#include "identify/spin_run.hpp"

namespace twinrate {

// psi_f, L_q over its current, the zero and the lag of the angle; fills the ticks of the segments.
void find_flux(const Experiment& e, std::vector<SpinRun>& segments, Identified& found);
// J, friction and torques of the turning motor. Needs psi_f.
void find_motion(const Experiment& e, const std::vector<SpinRun>& segments, Identified& found);

}  // namespace twinrate
