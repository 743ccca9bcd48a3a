// The gate (trace/gate.hpp) for logs of angle and current: what does not lower the error of judged
// rows by more than chance is taken out of what was found and named among the refused.
#pragma once
#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Transfer, claim by claim, the weakest first.
void refuse_claims(Found& found, const Judge& judge, TraceResult& r);
// All together: where they raise the error of a judged file, or predict worse than that nothing
// changes, none is kept.
void refuse_whole(Found& found, const Judge& judge, TraceResult& r);

}  // namespace twinrate
