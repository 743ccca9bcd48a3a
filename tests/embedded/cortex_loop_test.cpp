// The emulated Cortex-M3 in the loop: equal to the host build, however the background is interrupted
// and whatever the link.
#include "embedded/cortex_loop.hpp"

#include <gtest/gtest.h>

#include <cstring>

#include "embedded/instruction_counts.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::cortex_loop_test {
namespace {

// Control periods of the processor, s: 6250 and 150 instructions.
constexpr double kPeriod_s = 2e-4, kShort_s = 4.8e-6;

CortexRun run(const std::vector<std::string>& overrides, CortexLink link, double period_s) {
  std::vector<std::string> all = overrides;
  all.emplace_back("run.settle_s=0.01");
  Config config = load_drive("dilys2021", all);
  return run_cortex_loop(config, link, period_s, "");
}

TEST(Answer, IsReadBackAndADamagedOneRefused) {
  const m3::Answer answer{.k = 7, .i_alpha = -1, .theta = 0x80000000u, .gain_snapshot = -1};
  const m3::NewGain gain{.k = 5, .theta = 3, .K = {1, -2}, .P = {0, 0, 0, 4}};
  for (const m3::NewGain* sent : {static_cast<const m3::NewGain*>(nullptr), &gain}) {
    std::uint8_t wire[m3::kAnswerWire];
    const std::size_t size = m3::write_answer(answer, sent, wire);
    m3::Answer back{};
    m3::NewGain gain_back{};
    ASSERT_TRUE(m3::read_answer(wire, size - 1, back, gain_back));
    EXPECT_EQ(std::memcmp(&answer, &back, sizeof back), 0);
    if (sent)
      EXPECT_EQ(std::memcmp(&gain, &gain_back, sizeof gain), 0);
    else
      EXPECT_EQ(gain_back.k, -1);
    for (std::size_t i = 0; i + 1 < size; ++i) {
      wire[i] ^= 0x10;
      EXPECT_FALSE(m3::read_answer(wire, size - 1, back, gain_back)) << i;
      wire[i] ^= 0x10;
    }
  }
}

TEST(ProcessorInTheLoop, EqualsTheHostBuildBitForBit) {
  if (const std::string why = why_no_cortex(); !why.empty()) GTEST_SKIP() << why;
  const CortexRun r = run({"rates.n=5", "run.duration_s=0.1"}, CortexLink::kSemihosting, kPeriod_s);
  EXPECT_EQ(r.ticks, 500);
  EXPECT_EQ(r.equal_ticks, r.ticks);
  EXPECT_EQ(r.last.late, 0u);
}

TEST(ProcessorInTheLoop, GivesTheSameWithAPreemptedBackgroundTwice) {
  if (const std::string why = why_no_cortex(); !why.empty()) GTEST_SKIP() << why;
  const auto preempted = [] {
    return run({"rates.n=5", "run.duration_s=0.1"}, CortexLink::kSemihosting, kShort_s);
  };
  const CortexRun first = preempted(), second = preempted();
  EXPECT_GT(first.last.preempted, 90u);
  EXPECT_EQ(first.last.late, 0u);
  EXPECT_EQ(first.equal_ticks, first.ticks);
  EXPECT_EQ(first.log_crc, second.log_crc);
}

// A period too short for the background at n = 1: each miss is counted, nothing is silently wrong.
TEST(ProcessorInTheLoop, CountsABackgroundThatIsLate) {
  if (const std::string why = why_no_cortex(); !why.empty()) GTEST_SKIP() << why;
  const CortexRun r = run({"rates.n=1", "run.duration_s=0.02"}, CortexLink::kSemihosting, kShort_s);
  EXPECT_GT(r.last.late, 20u);
  EXPECT_LT(r.equal_ticks, r.ticks);
}

TEST(ProcessorInTheLoop, GivesTheSameOverTheUart) {
  if (const std::string why = why_no_cortex(); !why.empty()) GTEST_SKIP() << why;
  const std::vector<std::string> drive = {"rates.n=5", "run.duration_s=0.02"};
  const CortexRun uart = run(drive, CortexLink::kUart, kShort_s);
  EXPECT_EQ(uart.equal_ticks, uart.ticks);
  EXPECT_EQ(uart.log_crc, run(drive, CortexLink::kSemihosting, kShort_s).log_crc);
}

}  // namespace
}  // namespace twinrate::cortex_loop_test
