// A recorded drive: the messages of a log, into a Recording.
#pragma once
#include <atomic>
#include <string>

#include "scope/recording.hpp"

namespace twinrate::scope {

// `path`: a run directory or a log. Damaged events are skipped; returns what was (EventLog::damage).
// `share_read` goes from 0 to 1. Throws BadInput where there is no such log.
std::string load_log(const std::string& path, Recording& recording,
                     std::atomic<double>* share_read = nullptr);

}  // namespace twinrate::scope
