// Ticks of a recording as CSV.
#pragma once
#include <string>
#include <vector>

#include "scope/recording.hpp"

namespace twinrate::scope {

// k, t_s and the signals; a missing value is empty.
std::string ticks_csv(const Recording& recording, const std::vector<std::string>& signals,
                      Span span);
// A drive log (docs/trace-a-log.md) of the measured signals and the declared load. The voltage of
// row k is that of t_k .. t_{k+1}, which is in MEASUREMENT(k + 1). A tick without one of these two
// messages is left out. Throws BadInput if the range has no measurement.
std::string drive_log_csv(const Recording& recording, Span span);

}  // namespace twinrate::scope
