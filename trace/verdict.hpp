// The verdict of a trace and the beginning of its headline, the same for every problem: a drive log,
// angle and current, a static set, the bus.
#pragma once
#include <string>

#include "trace/result.hpp"

namespace twinrate {

// unexplained   structure is left that no effect passes for; or the trace was ended before the rows
//               that judge were asked
// traced        effects passed the gate
// ambiguous     effects passed that have another name; or none did, and the data allow no statement:
//               what was found was refused, and no structure is left without it
// nothing_missing
const char* verdict_of(const TraceResult& r);
// The refusal that counts most: of what is left, else the first that is no matter of size; null
// where there is none.
const Refused* refusal_to_tell(const TraceResult& r);
// Which rule refused what was found, and where; not what it was.
std::string refusal_in_words(const Refused& refused);
// "Nothing missing", said of the kinds alone that the data would show.
std::string nothing_in_words(const TraceResult& r);
// What a headline begins with that is not `traced`; empty for that.
std::string headline_begins(const TraceResult& r);

}  // namespace twinrate
