// From a selection to what is said of it: parameters with uncertainty, evidence, aliases, errors
// before and after, what stays unexplained and what this record could not tell.
#pragma once
#include "trace/bus_ripple.hpp"
#include "trace/gate.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

struct Conclusion {
  const Fitter &rounds,  // on the rows that fit
      &seen,             // on all that do not judge
      &last;             // on all, in the chain of all rows
  const Dictionary& dictionary;
  const Selection& selection;  // what passed the gate
  const Passed& passed;
  const Fit& fitted;  // by `last`
  const JudgedFiles& files;
  const Health& health;  // what the samples themselves show (clipping, missing and stale rows ..)
  const BusRipple& bus;  // what the bus voltage shows
};
TraceResult conclude(const Conclusion& c);

}  // namespace twinrate
