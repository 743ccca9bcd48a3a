// The figures of a log of any length, in constant memory. The log is read twice, message by
// message, and a third time for the part that a page shows.
//
// The figures are those of summarise(); the speed ripple is that of the last
// SummaryBuilder::kRippleTicks. A message that arrives more than kReach ticks after the newest one
// of its log is not used.
#pragma once
#include "analysis/run_ticks.hpp"

namespace twinrate {

struct LongLog {
  // Events, drive file and counts of the whole log; ticks of [first_k, last_k] only.
  RunLog log;
  RunTicks ticks;   // of those ticks
  Summary summary;  // of the whole log
  std::int64_t first_k = 0, last_k = 0;
  double begin_s = 0, end_s = 0;  // of the whole log
};

inline constexpr std::int64_t kReach = 4096;
// Ticks that a page shows: the end of the run, or the ticks around a loss. A tick takes 900 bytes
// in memory, 300 in a simulated run.
inline constexpr std::int64_t kTicksShown = 200'000;

// True if the log has more ticks than a page shows, by the size of its files. Throws BadInput: no
// such log.
bool is_long(const std::string& path);

// Throws as read_run_log().
LongLog summarise_log(const std::string& path, const DriveConfig& config, OnDamage on_damage,
                      std::int64_t ticks_shown = kTicksShown,
                      AngleReference reference = AngleReference::kAuto,
                      const std::string& channel_suffix = "");

// Summary::window_from_s, counted from the first tick of the part.
double window_of_part(const LongLog& part);

}  // namespace twinrate
