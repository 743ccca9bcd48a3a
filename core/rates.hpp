// Rates counted in ticks: f_s/f_b = n, and when a new gain is first used.
//
// The background takes a snapshot of x_hat every n ticks; K from snapshot s is
//   paper      first used one full T_b later, at tick s + n, and held n ticks (n = 1: the ordinary
//   EKF) immediate  first used at the next tick, s + 1, and held n ticks
// (docs/theory/two-rate-ekf.md; Dilys 2021, Fig. 3)
#pragma once
#include <cstdint>

namespace twinrate {

enum class GainPolicy : int { kPaper = 0, kImmediate = 1 };
inline constexpr const char* kGainPolicyNames[] = {"paper", "immediate"};

inline bool is_snapshot(std::int64_t k, int n) {
  return k % n == 0;
}

// First tick that may use the gain computed from `snapshot`.
inline std::int64_t first_use_of(GainPolicy policy, std::int64_t snapshot, int n) {
  return policy == GainPolicy::kPaper ? snapshot + n : snapshot + 1;
}

// Snapshot whose gain tick k uses; negative: none yet, K = 0.
inline std::int64_t snapshot_for_tick(GainPolicy policy, std::int64_t k, int n) {
  if (policy == GainPolicy::kPaper) return k < n ? -1 : k / n * n - n;
  return k < 1 ? -1 : (k - 1) / n * n;
}

}  // namespace twinrate
