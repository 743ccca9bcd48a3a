// Effects whose place on their grid has to be searched before Gauss-Newton can refine it, because
// the error is flat or rough around it.
#pragma once
#include "trace/scores.hpp"

namespace twinrate {

// A moment (load_step) searched more and more finely, a shaft by simplex; any other effect as it
// is.
std::shared_ptr<Effect> placed(const Fitter& fitter, const Fit& now,
                               const std::shared_ptr<Effect>& effect);

// A gap looks like a soft shaft until the load mass is followed through it, and its impacts make
// the error rough in the parameters: backlash in the place of the shaft `torsion`, searched on
// grids around it and away from it, then by simplex.
Fit search_backlash(const Fitter& fitter, const Fit& now, const Effect& torsion);

}  // namespace twinrate
