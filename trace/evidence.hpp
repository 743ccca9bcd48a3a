// What speaks for one effect of a fit: its parameters with standard deviations, what it gains, and
// the kinds that would explain the same.
#pragma once
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

// Of member m of `fit`, as the selection judged it.
TracedEffect traced_effect(const Fitter& fitter, const Fit& fit, const Selected& selected,
                           std::size_t m);
// The same effect with the parameters of another fit of the same members.
void take_parameters(const Fitter& fitter, const Fit& fit, std::size_t m, TracedEffect& e);

}  // namespace twinrate
