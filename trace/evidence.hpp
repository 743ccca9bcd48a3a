// Evidence for one effect of a fit: its parameters with standard deviations, its gain, and the
// kinds that explain the same.
#pragma once
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

// For member m of `fit`, as the selection judged it. `lag_is_open`: Conclusion::lag_is_open.
TracedEffect traced_effect(const Fitter& fitter, const Fit& fit, const Selected& selected,
                           std::size_t m, bool lag_is_open = false);
// The same effect with the parameters of another fit of the same members.
void take_parameters(const Fitter& fitter, const Fit& fit, std::size_t m, TracedEffect& e);

}  // namespace twinrate
