// From a selection to what is said of it: parameters with uncertainty, evidence, aliases, errors
// before and after, what stays unexplained and what this record could not tell.
#pragma once
#include "trace/bus_ripple.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

// `health` adds what the samples themselves show (clipping, a coarse ADC, missing and stale rows),
// `bus` what the bus voltage shows.
TraceResult conclude(const Fitter& fitter, const Dictionary& dictionary, const Selection& selection,
                     const Health& health, const BusRipple& bus);

}  // namespace twinrate
