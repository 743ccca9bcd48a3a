// The gains of a fast loop: the one in use and the next ones that wait for their tick.
#pragma once
#include <array>

#include "model/signals.hpp"

namespace twinrate {

// A gain set is taken over whole, at a tick boundary.
class GainSlots {
 public:
  void reset(const Gain& initial) {
    slots_.fill(initial);
    next_ = 0;
  }
  void push(const Gain& gain) {
    for (const Gain& slot : slots_)
      if (slot.k == gain.k) return;  // a repeat
    slots_[next_] = gain;
    next_ = (next_ + 1) % slots_.size();
  }
  bool has(std::int64_t snapshot) const {
    for (const Gain& slot : slots_)
      if (slot.k == snapshot) return true;
    return false;
  }
  // The newest gain not newer than `snapshot`: the planned one, or the one to hold when it is late.
  const Gain& newest_up_to(std::int64_t snapshot) const {
    const Gain* best = nullptr;
    for (const Gain& slot : slots_)
      if (slot.k <= snapshot && (!best || slot.k > best->k)) best = &slot;
    return best ? *best : slots_.front();
  }

 private:
  std::array<Gain, 4> slots_{};
  std::size_t next_ = 0;
};

}  // namespace twinrate
