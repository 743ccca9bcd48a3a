// bridge/device_clock: drift and offset from simulated arrival times.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "bridge/device_clock.hpp"
#include "bridge/round_trips.hpp"

namespace twinrate::clock_test {
namespace {

constexpr std::int64_t kLeastDelay_ns = 150'000;

struct Line {
  double drift, jitter_s, f_Hz;
  std::uint32_t first_us = 0;
};

// Frames over `t_s` of device time; returns the largest error of the line in us once it has settled.
double largest_error_us(DeviceClock& clock, const Line& line, double t_s, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<> jitter(0, line.jitter_s);
  std::int64_t last_ns = 0;
  double worst = 0;
  for (std::int64_t i = 0; static_cast<double>(i) < t_s * line.f_Hz; ++i) {
    const double t = static_cast<double>(i) / line.f_Hz;
    const auto us = std::llround(1e6 * t);
    const double earliest = 7e9 + 1e9 * t * (1 + line.drift) + kLeastDelay_ns;
    // A byte line keeps its order.
    last_ns = std::max<std::int64_t>(last_ns, std::llround(earliest + 1e9 * jitter(random)));
    clock.take(line.first_us + static_cast<std::uint32_t>(us), last_ns);
    if (clock.settled())
      worst = std::max(worst, 1e-3 * std::abs(static_cast<double>(clock.host_ns(us)) - earliest));
  }
  return worst;
}

TEST(DeviceClock, HoldsItsBoundAt100PpmAnd1MsOfJitter) {
  for (const double drift : {-100e-6, 0.0, 100e-6})
    for (const double f_Hz : {1000.0, 5000.0})
      for (unsigned seed = 1; seed <= 5; ++seed) {
        DeviceClock clock;
        const double worst = largest_error_us(clock, {drift, 1e-3, f_Hz}, 8, seed);
        EXPECT_TRUE(clock.settled());
        EXPECT_LT(worst, DeviceClock::kOffsetBound_us) << drift << " " << f_Hz << " " << seed;
        EXPECT_GT(worst, 0.01) << "an error of nothing would mean that nothing is estimated";
        EXPECT_NEAR(clock.drift(), drift, DeviceClock::kDriftBound);
      }
}

TEST(DeviceClock, IsExactWithoutJitter) {
  DeviceClock clock;
  EXPECT_LT(largest_error_us(clock, {50e-6, 0, 5000}, 5, 1), 1.0);  // device time is whole us
  EXPECT_NEAR(clock.drift(), 50e-6, 1e-6);
}

TEST(DeviceClock, WrapsAfter71Minutes) {
  DeviceClock clock;
  const std::uint32_t near_the_end = 0xffffffffu - 2'000'000;
  EXPECT_LT(largest_error_us(clock, {100e-6, 1e-3, 1000, near_the_end}, 6, 2),
            DeviceClock::kOffsetBound_us);
  EXPECT_NEAR(clock.drift(), 100e-6, DeviceClock::kDriftBound);
}

TEST(DeviceClock, TellsBeforeItHasSettled) {
  DeviceClock clock;
  EXPECT_FALSE(clock.known());
  clock.take(1000, 5'000'000);
  EXPECT_FALSE(clock.known());
  EXPECT_EQ(clock.host_ns(0), 5'000'000);
  clock.restart();
  EXPECT_FALSE(clock.known());
}

// Every eighth round trip is longer by far: a host that stalls.
TEST(RoundTrips, WhatIsUsualIsNotMovedByStalls) {
  constexpr std::int64_t us = 1000;
  RoundTrips trips;
  double usual_ns = 0;
  for (std::int64_t i = 0; i < 2000; ++i) {
    const std::int64_t t = i * 10'000 * us;
    trips.asked(t);
    const auto moment = trips.answered(t + (i % 8 == 0 ? 4000 : 200 + 10 * (i % 7)) * us);
    ASSERT_TRUE(moment);
    usual_ns = moment->usual_ns;
  }
  EXPECT_GT(usual_ns, 10 * us);
  EXPECT_LT(usual_ns, 30 * us) << "the mean is 250 us";
}

// An answer does not say to which question: after one that was not answered the line must be quiet.
TEST(RoundTrips, OnlyAnAnswerToTheOneOpenQuestionTellsAMoment) {
  constexpr std::int64_t ms = 1'000'000;
  RoundTrips trips;
  EXPECT_TRUE(trips.may_ask(0));
  trips.asked(0);
  EXPECT_FALSE(trips.may_ask(ms));
  auto moment = trips.answered(2 * ms);
  ASSERT_TRUE(moment);
  EXPECT_EQ(moment->read_ns, ms);
  EXPECT_EQ(moment->within_ns, 0);
  trips.asked(10 * ms);
  moment = trips.answered(13 * ms);
  ASSERT_TRUE(moment);
  EXPECT_NEAR(moment->within_ns, 0.5 * ms, 0.01 * ms);
  EXPECT_NEAR(static_cast<double>(trips.half_ns()), 1.0 * ms, 0.01 * ms);

  trips.asked(20 * ms);
  EXPECT_FALSE(trips.may_ask(69 * ms));
  EXPECT_TRUE(trips.may_ask(70 * ms));
  trips.asked(70 * ms);
  EXPECT_FALSE(trips.answered(71 * ms)) << "it may be the answer to the first question";
  EXPECT_FALSE(trips.may_ask(72 * ms)) << "that to the second may still come";
  EXPECT_FALSE(trips.answered(73 * ms));
  EXPECT_TRUE(trips.may_ask(123 * ms));
  trips.asked(123 * ms);
  EXPECT_TRUE(trips.answered(125 * ms));
}

}  // namespace
}  // namespace twinrate::clock_test
