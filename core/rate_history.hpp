// Rate and gain policy over the ticks of a run: as the drive file has them, then as they were
// changed while it ran.
//
// A change at tick T makes T a snapshot, and every tick up to the next multiple of the new n:
//
//   tick T             uses the gain that the rate before planned for it
//   T + 1 .. from      use the gain of the tick before; from: the first multiple of n above T
//   from + 1 ..        as core/rates.hpp with {n, from}
//
// A gain of a snapshot before T is therefore never used after T. While the filter has not agreed
// with itself (rates.n_from = "locked") every tick is a snapshot anyway.
#pragma once
#include <algorithm>
#include <utility>
#include <vector>

#include "core/rates.hpp"
#include "model/signals.hpp"

namespace twinrate {

struct RateChange {
  std::int64_t k = 0;
  int n = 1;
  GainPolicy policy = GainPolicy::kPaper;
  BackgroundRate rate() const { return {n, next_multiple(k + 1, n)}; }
};

class RateHistory {
 public:
  // `changes`: their ticks rise.
  RateHistory(GainPolicy policy, BackgroundRate rate, std::vector<RateChange> changes = {})
      : policy_(policy), rate_(rate), changes_(std::move(changes)) {}

  const std::vector<RateChange>& changes() const { return changes_; }
  bool changed_by(std::int64_t k) const { return last_change(k) != nullptr; }
  GainPolicy policy_at(std::int64_t k) const {
    const RateChange* change = last_change(k);
    return change ? change->policy : policy_;
  }
  BackgroundRate rate_at(std::int64_t k) const {
    const RateChange* change = last_change(k);
    return change ? change->rate() : rate_;
  }
  // True if tick k sends a gain; `estimate_status`: of its ESTIMATE.
  bool sends_gain(std::int64_t k, int estimate_status) const {
    return has_background(policy_at(k)) &&
           (estimate_status & kGainEveryTick || is_snapshot(k, rate_at(k)));
  }
  // Gains of the ticks after `first` up to `last`. `before`: the rate before the first change, as it
  // is known.
  std::int64_t gains_between(std::int64_t first, std::int64_t last, BackgroundRate before) const {
    std::int64_t count = 0;
    for (std::size_t i = 0; i <= changes_.size(); ++i) {
      const std::int64_t begin = i == 0 ? -1 : changes_[i - 1].k - 1;
      const std::int64_t end = i == changes_.size() ? last : std::min(last, changes_[i].k - 1);
      const std::int64_t from = std::max(first, begin);
      if (end <= from || !has_background(i == 0 ? policy_ : changes_[i - 1].policy)) continue;
      const BackgroundRate rate = i == 0 ? before : changes_[i - 1].rate();
      count += snapshots_up_to(end, rate) - snapshots_up_to(from, rate);
    }
    return count;
  }

 private:
  const RateChange* last_change(std::int64_t k) const {
    for (auto change = changes_.rbegin(); change != changes_.rend(); ++change)
      if (change->k <= k) return &*change;
    return nullptr;
  }
  GainPolicy policy_;
  BackgroundRate rate_;
  std::vector<RateChange> changes_;
};

}  // namespace twinrate
