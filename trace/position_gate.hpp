// The gate (trace/gate.hpp) for logs of angle and current. A claim that does not lower the error of
// judged rows beyond chance is removed from the findings and reported as refused.
#pragma once
#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Rule of transfer, claim by claim, the weakest first.
void refuse_claims(Found& found, const Judge& judge, TraceResult& r);
// All claims together: if they raise the error of a judged file, or predict worse than no change,
// none is kept.
void refuse_whole(Found& found, const Judge& judge, TraceResult& r);

}  // namespace twinrate
