// A recorded drive: reads the messages of a log into a Recording.
#pragma once
#include <atomic>
#include <string>

#include "scope/recording.hpp"

namespace twinrate::scope {

// `path`: a run directory or a log. Damaged events are skipped; returns their description
// (EventLog::damage). `share_read` rises from 0 to 1. Throws BadInput if there is no such log.
std::string load_log(const std::string& path, Recording& recording,
                     std::atomic<double>* share_read = nullptr);

}  // namespace twinrate::scope
