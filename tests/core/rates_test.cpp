#include "core/rates.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

namespace twinrate {
namespace {

class Rates : public testing::TestWithParam<int> {};

// Oracle by search: the newest multiple of n whose window of use contains k.
std::int64_t by_search(std::int64_t k, int n, std::int64_t first, std::int64_t last) {
  for (std::int64_t s = 0; s <= k; s += n)
    if (k >= s + first && k <= s + last) return s;
  return -1;
}

TEST_P(Rates, PaperUsesAGainFromOnePeriodAfterItsSnapshotForOnePeriod) {
  const int n = GetParam();
  for (std::int64_t k = 0; k < 20 * n; ++k)
    EXPECT_EQ(snapshot_for_tick(GainPolicy::kPaper, k, n), by_search(k, n, n, 2 * n - 1)) << k;
}

TEST_P(Rates, ImmediateUsesItFromTheNextTickForOnePeriod) {
  const int n = GetParam();
  for (std::int64_t k = 0; k < 20 * n; ++k)
    EXPECT_EQ(snapshot_for_tick(GainPolicy::kImmediate, k, n), by_search(k, n, 1, n)) << k;
}

TEST_P(Rates, PropagatedUsesTheGainOfTheStartAtOnceAndTheOthersLikePaper) {
  const int n = GetParam();
  for (std::int64_t k = 0; k < 20 * n; ++k)
    EXPECT_EQ(snapshot_for_tick(GainPolicy::kPropagated, k, n),
              k == 0 ? -1 : std::max<std::int64_t>(0, by_search(k, n, n, 2 * n - 1)))
        << k;
}

TEST_P(Rates, FirstUseIsTheFirstTickThatPlansToUseIt) {
  const int n = GetParam();
  for (GainPolicy policy :
       {GainPolicy::kPaper, GainPolicy::kImmediate, GainPolicy::kRotate, GainPolicy::kPropagated}) {
    for (std::int64_t s = 0; s < 5 * n; s += n) {
      const std::int64_t first = first_use_of(policy, s, n);
      EXPECT_EQ(snapshot_for_tick(policy, first, n), s);
      EXPECT_NE(snapshot_for_tick(policy, first - 1, n), s);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(N, Rates, testing::Values(1, 2, 3, 4, 5, 10, 11, 12, 13, 500));

TEST(RatesAtOne, WithOneTickAGainBothPoliciesAreTheOrdinaryEkf) {
  for (std::int64_t k = 1; k < 100; ++k) {
    EXPECT_EQ(snapshot_for_tick(GainPolicy::kPaper, k, 1), k - 1);
    EXPECT_EQ(snapshot_for_tick(GainPolicy::kImmediate, k, 1), k - 1);
  }
}

// One gain a tick before tick 30, every fifth from there on: by search over the snapshots.
TEST(SwitchedRate, EveryTickUsesTheNewestGainThatCanBeThere) {
  const BackgroundRate rate(5, 30);
  for (GainPolicy policy :
       {GainPolicy::kPaper, GainPolicy::kImmediate, GainPolicy::kRotate, GainPolicy::kPropagated}) {
    std::int64_t snapshots = 0;
    for (std::int64_t k = 0; k < 80; ++k) {
      std::int64_t newest = -1;
      for (std::int64_t s = 0; s < k; ++s)
        if (is_snapshot(s, rate) && first_use_of(policy, s, rate) <= k) newest = s;
      EXPECT_EQ(snapshot_for_tick(policy, k, rate), newest) << k;
      EXPECT_EQ(is_snapshot(k, rate), k < 30 || k % 5 == 0) << k;
      snapshots += is_snapshot(k, rate);
      EXPECT_EQ(snapshots_up_to(k, rate), snapshots) << k;
    }
  }
}

TEST(ScheduledRate, NoTickPlansOnASnapshot) {
  for (std::int64_t k = 0; k < 20; ++k)
    EXPECT_EQ(snapshot_for_tick(GainPolicy::kScheduled, k, 3), -1);
}

RC_GTEST_PROP(RatesProperty, AGainIsNeverUsedBeforeItCanBeThere,
              (unsigned short tick, unsigned char n_less)) {
  const int n = n_less + 1;
  for (GainPolicy policy :
       {GainPolicy::kPaper, GainPolicy::kImmediate, GainPolicy::kRotate, GainPolicy::kPropagated}) {
    const std::int64_t s = snapshot_for_tick(policy, tick, n);
    RC_ASSERT(s < std::max<std::int64_t>(tick, 0));
    RC_ASSERT(s < 0 || is_snapshot(s, n));
  }
}

}  // namespace
}  // namespace twinrate
