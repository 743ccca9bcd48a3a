// Why a tick of the realtime plant began late.
#include "plant_sim/overrun.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace twinrate {
namespace {

constexpr std::int64_t kPeriod = 200'000, kLate = 300'000;

TEST(OverrunCause, IsWhatTookTheTime) {
  EXPECT_EQ(cause_of_delay({.cpu_ns = 40'000, .waited_ns = 290'000}, kLate, kPeriod),
            "another process had the CPU for 290 us");
  EXPECT_EQ(cause_of_delay({.cpu_ns = 480'000, .waited_ns = 9'000}, kLate, kPeriod),
            "the plant worked for 480 us");
  EXPECT_EQ(
      cause_of_delay({.cpu_ns = 40'000, .waited_ns = 0, .pages_from_disk = 2}, kLate, kPeriod),
      "2 pages came from disk");
  EXPECT_EQ(cause_of_delay({.cpu_ns = 40'000, .waited_ns = 0}, kLate, kPeriod),
            "the machine woke it late");
  EXPECT_EQ(cause_of_delay({.cpu_ns = 40'000, .waited_ns = -1}, kLate, kPeriod),
            "the machine woke it late")
      << "the kernel does not tell";
}

TEST(OverrunReport, SpeaksOnceIn100MillisecondsAndCountsTheRest) {
  OverrunReport report;
  EXPECT_EQ(report.take(0, kLate, "why"), "tick began 300 us late: why");
  EXPECT_EQ(report.take(50'000'000, kLate, "why"), "");
  EXPECT_EQ(report.take(99'999'999, kLate, "why"), "");
  EXPECT_EQ(report.take(100'000'000, kLate, "why"),
            "tick began 300 us late: why (2 more since the last report)");
  EXPECT_EQ(report.take(200'000'000, kLate, "why"), "tick began 300 us late: why");
  EXPECT_EQ(report.take(210'000'000, 2 * kLate, "why"), "tick began 600 us late: why") << "worse";
}

TEST(ThreadClock, CountsWorkAndNotSleep) {
  const ThreadClock clock;
  const ThreadTimes before = clock.now();
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  const std::int64_t slept = clock.now().cpu_ns - before.cpu_ns;
  EXPECT_LT(slept, 10'000'000);
  while (clock.now().cpu_ns - before.cpu_ns < slept + 5'000'000) {
  }
  EXPECT_GE(clock.now().cpu_ns - before.cpu_ns, 5'000'000);
}

}  // namespace
}  // namespace twinrate
