// The gains of a fast loop: the one in use and the next ones that wait for their tick.
#pragma once
#include <algorithm>
#include <array>

#include "model/signals.hpp"

namespace twinrate {

// True if a gain has the sizes of the filter's `first` gain, is finite, and has a covariance with a
// positive diagonal (zero only if that of `first` is zero there).
inline bool fits(const Gain& gain, const Gain& first) {
  if (gain.n_x != first.n_x || gain.n_y != first.n_y) return false;
  if (!gain.K.topLeftCorner(gain.n_x, gain.n_y).allFinite()) return false;
  if (!gain.P.topLeftCorner(gain.n_x, gain.n_x).allFinite()) return false;
  for (int i = 0; i < gain.n_x; ++i)
    if (gain.P(i, i) < 0 || (gain.P(i, i) == 0 && first.P(i, i) > 0)) return false;
  return true;
}

// Copies a gain. Of gains of equal size only the used blocks are copied, because a Gain has room
// for the largest filter.
inline void copy_gain(Gain& to, const Gain& from) {
  if (from.n_x == 0 || to.n_x != from.n_x || to.n_y != from.n_y) {
    to = from;
    return;
  }
  to.k = from.k;
  to.t_ns = from.t_ns;
  to.first_use = from.first_use;
  to.theta_e = from.theta_e;
  for (int col = 0; col < from.n_y; ++col)
    for (int row = 0; row < from.n_x; ++row) to.K(row, col) = from.K(row, col);
  for (int col = 0; col < from.n_x; ++col)
    for (int row = 0; row < from.n_x; ++row) to.P(row, col) = from.P(row, col);
  to.n_speeds = from.n_speeds;
  std::copy_n(from.at_speed.begin(), from.n_speeds, to.at_speed.begin());
}

// Stores gains. A gain set is replaced as a whole, at a tick boundary.
class GainSlots {
 public:
  void reset(const Gain& initial) { slots_.fill(initial); }
  // Replaces the oldest gain. A repeated gain, or one older than all stored gains, changes nothing.
  void push(const Gain& gain) {
    Gain* oldest = &slots_.front();
    for (Gain& slot : slots_) {
      if (slot.k == gain.k) return;
      if (slot.k < oldest->k) oldest = &slot;
    }
    if (gain.k > oldest->k) copy_gain(*oldest, gain);
  }
  bool has(std::int64_t snapshot) const {
    for (const Gain& slot : slots_)
      if (slot.k == snapshot) return true;
    return false;
  }
  // The newest gain not newer than `snapshot`: the planned gain, or the held one if the planned
  // gain is late.
  const Gain& newest_up_to(std::int64_t snapshot) const {
    const Gain* best = nullptr;
    for (const Gain& slot : slots_)
      if (slot.k <= snapshot && (!best || slot.k > best->k)) best = &slot;
    return best ? *best : slots_.front();
  }

 private:
  std::array<Gain, 4> slots_{};
};

}  // namespace twinrate
