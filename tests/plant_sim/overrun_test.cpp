// Why a tick of the realtime plant began late.
#include "plant_sim/overrun.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

namespace twinrate {
namespace {

constexpr std::int64_t kPeriod = 200'000, kLate = 300'000;

TEST(OverrunCause, IsWhatTookTheTime) {
  EXPECT_EQ(late_text({.cpu_ns = 40'000, .waited_ns = 290'000}, kLate, kPeriod),
            "tick began 300 us late: another process had the CPU for 290 us");
  EXPECT_EQ(late_text({.cpu_ns = 480'000, .waited_ns = 9'000}, kLate, kPeriod),
            "tick began 300 us late: the plant worked for 480 us");
  EXPECT_EQ(late_text({.cpu_ns = 40'000, .waited_ns = 0, .pages_from_disk = 2}, kLate, kPeriod),
            "tick began 300 us late: 2 pages came from disk");
  EXPECT_EQ(late_text({.cpu_ns = 40'000, .waited_ns = 0}, kLate, kPeriod),
            "tick began 300 us late: it was woken late");
  EXPECT_EQ(late_text({.cpu_ns = 40'000, .waited_ns = -1}, kLate, kPeriod),
            "tick began 300 us late: it was woken late")
      << "the kernel does not tell";
  EXPECT_EQ(late_text({.cpu_ns = 234'000, .waited_ns = 9'000}, 290'000'000, kPeriod),
            "tick began 290000 us late: it was woken late")
      << "a process that was stopped worked for 234 us before";
}

TEST(PacedEvents, SpeakOnceIn100MillisecondsAndCountTheRest) {
  PacedEvents events;
  EXPECT_EQ(events.take(0, kLate, "late"), "late");
  EXPECT_EQ(events.take(50'000'000, kLate, "late"), "");
  EXPECT_EQ(events.take(99'999'999, kLate, "late"), "");
  EXPECT_EQ(events.since(), 2);
  EXPECT_EQ(events.take(100'000'000, kLate, "late"), "late (2 more since the last report)");
  EXPECT_EQ(events.since(), 0);
  EXPECT_EQ(events.take(200'000'000, kLate, "late"), "late");
  EXPECT_EQ(events.take(210'000'000, 2 * kLate, "later"), "later") << "worse";
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
