// Ticks of a recording as CSV.
#pragma once
#include <string>
#include <vector>

#include "scope/recording.hpp"

namespace twinrate::scope {

// k, t_s and the signals; a value that is not there is empty.
std::string ticks_csv(const Recording& recording, const std::vector<std::string>& signals,
                      Span span);
// A drive log (docs/trace-a-log.md) of what was measured there, with the load that was declared for it.
// The voltage of row k is that of t_k .. t_{k+1}, which is in MEASUREMENT(k + 1). A tick without one
// of these is left out. Throws BadInput where nothing was measured.
std::string drive_log_csv(const Recording& recording, Span span);

}  // namespace twinrate::scope
