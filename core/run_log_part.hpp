// A log that need not fit into memory: one message after the other, or a part of its ticks.
#pragma once
#include <functional>

#include "core/run_log.hpp"

namespace twinrate {

// Reads everything that read_run_log() reads except the messages of ticks, which go to `take` in
// the order of the log. The first kEventsKept events are kept, and as many trips after them. Throws
// as read_run_log().
inline constexpr std::size_t kEventsKept = 20000;
RunLog scan_run_log(const std::string& path, const std::string& channel_suffix, OnDamage on_damage,
                    const std::function<void(Channel, const lcm::LogEvent&)>& take);

// The messages of ticks `first` to `last`, and the gains that are used there; events and counts are
// those of the whole log. `n` is the rate ratio.
RunLog read_run_log_part(const std::string& path, const std::string& channel_suffix,
                         OnDamage on_damage, std::int64_t first, std::int64_t last, int n);

}  // namespace twinrate
