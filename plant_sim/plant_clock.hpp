// The clock of the simulated plant in realtime.
//
//   due(k) = start + stood + t_k
//
// The plant is awake at `now` for tick k, late by now - due(k):
//
//   up to T_s     the clock does not move: the next tick keeps its time
//   above T_s     a stall: stood += late, tick k is due now
//
// The drive is simulated: while its process does not run, its time does not pass. The ticks of a
// stall are not made up at once, because nobody could answer them. If the due COMMAND is missing
// after a stall, its sender may have stalled with the plant: the clock waits for one more T_s,
// once, so that every tick leaves the sender a whole period in which the plant was awake. This does
// not help a sender that is late while the plant is awake.
#pragma once
#include <algorithm>
#include <cstdint>

#include "core/stall_text.hpp"

namespace twinrate {

class PlantClock {
 public:
  PlantClock(std::int64_t start_ns, std::int64_t period_ns)
      : start_ns_(start_ns), period_ns_(period_ns) {}

  std::int64_t due(std::int64_t t_ns) const { return start_ns_ + stood_ns_ + t_ns; }

  struct Begin {
    std::int64_t late_ns = 0;   // of the first wake-up
    std::int64_t stood_ns = 0;  // 0: no stall
  };
  // Waits for the tick of drive time t_ns. wait_until(ns) returns then or later, now() gives the
  // time, command_is_missing() is called after a stall.
  template <class WaitUntil, class Now, class CommandIsMissing>
  Begin begin(std::int64_t t_ns, WaitUntil wait_until, Now now,
              CommandIsMissing command_is_missing) {
    const std::int64_t stood_before = stood_ns_;
    wait_until(due(t_ns));
    const std::int64_t late_ns = now() - due(t_ns);
    if (stand_if_stalled(late_ns) && command_is_missing()) {
      stood_ns_ += period_ns_;
      wait_until(due(t_ns));
      stand_if_stalled(now() - due(t_ns));
    }
    return {late_ns, stood_ns_ - stood_before};
  }
  StallCount count() const {
    return {stalls_, 1e-9 * static_cast<double>(stood_ns_),
            1e-9 * static_cast<double>(longest_ns_)};
  }

 private:
  bool stand_if_stalled(std::int64_t late_ns) {
    if (late_ns <= period_ns_) return false;
    ++stalls_;
    stood_ns_ += late_ns;
    longest_ns_ = std::max(longest_ns_, late_ns);
    return true;
  }

  std::int64_t start_ns_, period_ns_;
  std::int64_t stood_ns_ = 0, stalls_ = 0, longest_ns_ = 0;
};

}  // namespace twinrate
