// Marks of a log's writer: events on a channel that is none of the drive's, which no process hears.
//
//   after the manifest of a part    "begins", or "goes on" where a logger was started again
//   at the end of a part            "continues" in the next part, or "ends"
//
// A log that was cut, or whose writer was killed or ran out of disk, begins and does not end
// (core/event_log.hpp). One without marks is of an earlier program or of another logger.
#pragma once
#include <string_view>

namespace twinrate {

constexpr std::string_view kLogMarkChannel = "TWINRATE_LOG";
constexpr std::string_view kLogBegins = "begins", kLogGoesOn = "goes on", kLogEnds = "ends",
                           kLogContinues = "continues";

}  // namespace twinrate
