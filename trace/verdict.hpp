// The verdict of a trace and the beginning of its headline, the same for every problem: a drive
// log, angle and current, a static set, the bus.
#pragma once
#include <string>

#include "trace/result.hpp"

namespace twinrate {

// unexplained structure remains that no effect explains; or the trace was ended before the judging
//               rows were read
// traced effects passed the gate ambiguous effects passed that have an alias; or none passed, and
// the data allow no statement:
//               the findings were refused, and no structure remains without them
// nothing_missing
const char* verdict_of(const TraceResult& r);
// The refusal that matters most: one whose claim lowers the error of judging rows beyond chance,
// else the first. Refusals for the size or by the sensors do not count; null if there is none.
const Refused* refusal_to_tell(const TraceResult& r);
// The rule that refused the findings, and where; without their kind.
std::string refusal_in_words(const Refused& refused);
// "Nothing missing", only for the kinds that the data would show.
std::string nothing_in_words(const TraceResult& r);
// The beginning of a headline if the verdict is not `traced`, else empty.
std::string headline_begins(const TraceResult& r);

}  // namespace twinrate
