#include "model/order_sources.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

namespace twinrate {
namespace {

using enum Source;
using Sources = std::vector<OrderSource>;

// The conclusions of Niewiara 2020, for its motor of 3 pole pairs and 27 slots.
TEST(OrderSources, OfThePapersMotorAreThePapers) {
  const std::map<int, Sources> expected = {
      {1, {{kShaft, 1}}},
      {3, {{kCurrentOffset, 1}}},
      {6, {{kCurrentScaling, 1}, {kPoleCogging, 1}}},
      {12, {{kPoleCogging, 2}}},
      {18, {{kDeadTimeAndFlux, 1}, {kPoleCogging, 3}}},
      {36, {{kDeadTimeAndFlux, 2}, {kPoleCogging, 6}}},
      {54, {{kDeadTimeAndFlux, 3}, {kPoleCogging, 9}, {kSlotCogging, 2}, {kNativeCogging, 1}}},
      {9, {{kOffsetProduct, 3}}},
      {15, {{kOffsetProduct, 5}}},
      {2, {}},
      {7, {}},
      {53, {}},
  };
  for (const auto& [N, sources] : expected) EXPECT_EQ(order_sources(N, 3, 27), sources) << N;
  EXPECT_EQ(order_sources(27, 3, 27), (Sources{{kSlotCogging, 1}}));
}

// 12 pole pairs and 18 slots: lcm(18, 24) = 72 is native, 18, 36 and 54 the slots' alone.
TEST(OrderSources, FollowTheNumbersOfPolesAndSlots) {
  EXPECT_EQ(
      order_sources(72, 12, 18),
      (Sources{{kDeadTimeAndFlux, 1}, {kPoleCogging, 3}, {kSlotCogging, 4}, {kNativeCogging, 1}}));
  EXPECT_EQ(order_sources(18, 12, 18), (Sources{{kSlotCogging, 1}}));
  EXPECT_EQ(order_sources(54, 12, 18), (Sources{{kSlotCogging, 3}}));
  EXPECT_EQ(order_sources(12, 12, 18), (Sources{{kCurrentOffset, 1}}));
  EXPECT_EQ(order_sources(24, 12, 18), (Sources{{kCurrentScaling, 1}, {kPoleCogging, 1}}));
  EXPECT_EQ(order_sources(3, 12, 18), Sources{});
}

// One pole pair: shaft and current offset both have order 1.
TEST(OrderSources, MayFallTogetherWithTheShaft) {
  EXPECT_EQ(order_sources(1, 1, 0), (Sources{{kShaft, 1}, {kCurrentOffset, 1}}));
}

TEST(OrderSources, LeaveSlotsOutWhereTheirNumberIsNotKnown) {
  for (int N = 1; N <= 120; ++N)
    for (const OrderSource& found : order_sources(N, 3, 0)) {
      EXPECT_NE(found.source, kSlotCogging) << N;
      EXPECT_NE(found.source, kNativeCogging) << N;
    }
}

TEST(OrderSources, SayWhereTheyOverlap) {
  EXPECT_EQ(describe(order_sources(6, 3, 27)),
            "current scaling; cogging from the poles: cannot be told apart at one speed and load");
  EXPECT_EQ(describe(order_sources(3, 3, 27)), "current offset");
  EXPECT_EQ(describe(order_sources(7, 3, 27)), "");
  EXPECT_EQ(label(order_sources(6, 3, 27)), "scaling+poles");
}

}  // namespace
}  // namespace twinrate
