// Rates counted in ticks: f_s/f_b = n, and when a new gain is first used.
//
// The background takes a snapshot of x_hat every n ticks. K from snapshot s:
//
//   immediate    first used at the next tick, s + 1, and held n ticks
//   scheduled    none: every tick reads its gain from a table over speed
//   all others   first used one full T_b later, at tick s + n, and held n ticks (n = 1: the
//                ordinary EKF); with policy propagated the gain of tick 0 is used from tick 1 on
//
// estimator/two_rate.hpp defines how a policy changes the gain before its use.
// Source: docs/theory/two-rate-ekf.md; Dilys 2021, Fig. 3.
#pragma once
#include <cstdint>

namespace twinrate {

enum class GainPolicy : int {
  kPaper = 0,
  kImmediate = 1,
  kExtrapolate = 2,
  kRotate = 3,
  kRotorFrame = 4,
  kScheduled = 5,
  kPropagated = 6,
};
inline constexpr const char* kGainPolicyNames[] = {
    "paper", "immediate", "extrapolate", "rotate", "rotor_frame", "scheduled", "propagated"};

// When a gain every n ticks begins: at rates.n_from_s (0: with the run), or once the filter agrees
// with itself (estimator/agreement.hpp). Before it a gain is computed every tick.
enum class NFrom : int { kStart = 0, kLocked = 1 };
inline constexpr const char* kNFromNames[] = {"start", "locked"};

// One gain every n ticks; before tick `from` (a multiple of n) one every tick.
struct BackgroundRate {
  static constexpr std::int64_t kNotYet = INT64_MAX;  // `from` while it is not known
  constexpr BackgroundRate(int ticks, std::int64_t from_tick = 0) : n(ticks), from(from_tick) {}
  int n;
  std::int64_t from;
  // Ticks between the snapshot at k and the next.
  int n_at(std::int64_t k) const { return k < from ? 1 : n; }
};

inline bool is_snapshot(std::int64_t k, BackgroundRate rate) {
  return k % rate.n_at(k) == 0;
}
// Number of snapshots in ticks 0 .. k.
inline std::int64_t snapshots_up_to(std::int64_t k, BackgroundRate rate) {
  return k < rate.from ? k + 1 : rate.from + (k - rate.from) / rate.n + 1;
}

// The fast loop turns the gain with the rotor.
inline bool turns_gain(GainPolicy policy) {
  return policy == GainPolicy::kRotate || policy == GainPolicy::kRotorFrame;
}
// True if the fast loop computes its gain of each tick from the sent one.
inline bool is_made_for_use(GainPolicy policy) {
  return turns_gain(policy) || policy == GainPolicy::kPropagated;
}
// A background runs and sends gains.
inline bool has_background(GainPolicy policy) {
  return policy != GainPolicy::kScheduled;
}

// First tick that may use the gain computed from `snapshot`.
inline std::int64_t first_use_of(GainPolicy policy, std::int64_t snapshot, BackgroundRate rate) {
  const bool at_once =
      policy == GainPolicy::kImmediate || (policy == GainPolicy::kPropagated && snapshot == 0);
  return at_once ? snapshot + 1 : snapshot + rate.n_at(snapshot);
}
// The first multiple of n at or after tick k.
inline std::int64_t next_multiple(std::int64_t k, int n) {
  return (k + n - 1) / n * n;
}

// Snapshot whose gain tick k uses; negative: none (yet), K = 0 unless there is a table.
inline std::int64_t snapshot_for_tick(GainPolicy policy, std::int64_t k, BackgroundRate rate) {
  if (!has_background(policy)) return -1;
  const int n = rate.n;
  if (k <= rate.from) return k < 1 ? -1 : k - 1;
  if (policy == GainPolicy::kImmediate) return (k - 1) / n * n;
  if (k >= rate.from + n) return k / n * n - n;
  return policy == GainPolicy::kPropagated && rate.from == 0 ? 0 : rate.from - 1;
}

}  // namespace twinrate
