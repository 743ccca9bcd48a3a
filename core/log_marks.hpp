// Marks of a log's writer: events on a channel that is not of the drive and that no process reads.
//
//   after the manifest of a part    "begins", or "goes on" if a logger was started again
//   at the end of a part            "continues" in the next part, or "ends"
//
// A log that was truncated, or whose writer was killed or had a full disk, begins and does not end
// (core/event_log.hpp). A log without marks comes from an earlier program or from another logger.
#pragma once
#include <string_view>

namespace twinrate {

constexpr std::string_view kLogMarkChannel = "TWINRATE_LOG";
constexpr std::string_view kLogBegins = "begins", kLogGoesOn = "goes on", kLogEnds = "ends",
                           kLogContinues = "continues";

}  // namespace twinrate
