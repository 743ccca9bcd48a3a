// For the pictures: each traced effect beside the residual that it explains, for a check by eye.
//
//   without = residual of the model with all the other traced effects
//   share   = without - residual of the model with all of them
#pragma once
#include "trace/fit.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Fills `views` of the effects and stop-gaps of `result` that are members of `fit`. Channels in
// which an effect changes nothing are left out.
void add_effect_views(const Chain& chain, const Fit& fit, TraceResult& result);

}  // namespace twinrate
