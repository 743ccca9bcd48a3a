// From a selection to its result: parameters with uncertainty, evidence, aliases, errors before and
// after, the unexplained structure and the kinds that this record cannot show.
#pragma once
#include "trace/bus_ripple.hpp"
#include "trace/gate.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

struct Conclusion {
  const Fitter &rounds,  // on the rows that fit
      &seen,             // on all rows that do not judge
      &last;             // on all rows, in the chain of all rows
  const Dictionary& dictionary;
  const Selection& selection;  // what passed the gate
  const Passed& passed;
  const Fit& fitted;  // by `last`
  const JudgedFiles& files;
  const Health& health;  // findings from the samples (clipping, missing and stale rows ..)
  const BusRipple& bus;  // findings from the bus voltage
  // The moment of the voltage is not known: a lag, or an offset of the encoder, may be there that is
  // too small to be traced.
  bool lag_is_open = false;
};
TraceResult conclude(const Conclusion& c);

}  // namespace twinrate
