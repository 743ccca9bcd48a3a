// Statistics of a channel from headers alone: gaps, repeats, rates and latencies.
#include <gtest/gtest.h>

#include "core/watched_channel.hpp"
#include "tools/watch/key_values.hpp"

namespace twinrate {
namespace {

template <class Message>
std::vector<std::uint8_t> encoded(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

void take(WatchedChannel& account, std::int64_t seq, std::int64_t arrival_us,
          const TickTimes& ticks = {}) {
  const std::uint8_t bytes[32] = {};
  account.take({.seq = seq, .t_ns = 200'000 * seq, .session = 7}, bytes, sizeof bytes, arrival_us,
               ticks);
}

TEST(MessageHeaderTest, IsReadWithoutTheTypeOfTheMessage) {
  estimate_t estimate{};
  estimate.seq = 0x0102030405060708;
  estimate.t_ns = -5;
  estimate.session = 42;
  const auto bytes = encoded(estimate);
  const auto header = read_header(bytes.data(), bytes.size());
  ASSERT_TRUE(header);
  EXPECT_EQ(header->seq, 0x0102030405060708);
  EXPECT_EQ(header->t_ns, -5);
  EXPECT_EQ(header->session, 42);
  EXPECT_FALSE(read_header(bytes.data(), 31));
}

TEST(WatchedChannelTest, CountsGapsAndRepeats) {
  WatchedChannel account(Channel::kMeasurement);
  account.begin_interval(0);
  for (const int seq : {10, 11, 14, 14, 15}) take(account, seq, 1000 * seq);
  EXPECT_EQ(account.messages(), 5);
  EXPECT_EQ(account.gaps(), 2);
  EXPECT_EQ(account.repeats(), 1);
  EXPECT_EQ(account.last_seq(), 15);
  EXPECT_DOUBLE_EQ(account.rate_Hz(20'000), 250);
  EXPECT_DOUBLE_EQ(account.age_s(16'000), 1e-3);
}

TEST(WatchedChannelTest, ATickThatAnotherOneOvertookIsNoGapAndNoRepeat) {
  WatchedChannel account(Channel::kTruth);
  for (const std::int64_t k : {5, 4, 6, 8, 7, 7, 12, 10, 10, 6}) take(account, k, 0);
  EXPECT_EQ(account.gaps(), 2);     // 9 and 11
  EXPECT_EQ(account.repeats(), 4);  // 4 (from before the first one), 7, 10, 6
  take(account, 2000, 0);
  take(account, 11, 0);  // too long ago to know
  EXPECT_EQ(account.gaps(), 2 + 1987);
  EXPECT_EQ(account.repeats(), 5);
}

TEST(WatchedChannelTest, AGainEveryNthTickIsNoGap) {
  WatchedChannel account(Channel::kGain);
  for (const int seq : {0, 5, 10, 25, 30}) take(account, seq, seq);
  EXPECT_EQ(account.gaps(), 2);
}

// GAIN as on the wire; `ahead`: ticks to its first use.
void take_gain(WatchedChannel& account, std::int64_t seq, std::int64_t ahead) {
  gain_t gain{};
  gain.seq = seq;
  gain.first_use_seq = seq + ahead;
  const auto bytes = encoded(gain);
  account.take({.seq = seq, .t_ns = 200'000 * seq, .session = 7}, bytes.data(), bytes.size(), seq,
               TickTimes{});
}

TEST(WatchedChannelTest, AGainEveryTickUntilTheFilterAgreesIsNoGapAfterwards) {
  WatchedChannel account(Channel::kGain);
  for (int seq = 0; seq < 10; ++seq) take_gain(account, seq, 1);
  for (int seq = 10; seq < 100; seq += 5) take_gain(account, seq, 5);
  EXPECT_EQ(account.gaps(), 0);
  take_gain(account, 105, 5);  // 100 is missing
  EXPECT_EQ(account.gaps(), 1);
  for (const int seq : {107, 108, 109}) take_gain(account, seq, 1);  // n was changed at 107
  for (const int seq : {112, 115, 121}) take_gain(account, seq, 3);  // 118 is missing
  EXPECT_EQ(account.gaps(), 2);
  account.pause();  // policy scheduled
  take_gain(account, 500, 3);
  EXPECT_EQ(account.gaps(), 2);
}

TEST(WatchedChannelTest, WithPolicyImmediateANewRateIsNoGap) {
  WatchedChannel account(Channel::kGain);
  for (const int seq : {0, 1, 2, 3, 4, 5, 10, 15, 20}) take_gain(account, seq, 1);
  EXPECT_EQ(account.gaps(), 0);
  for (const int seq : {30, 35}) take_gain(account, seq, 1);
  EXPECT_EQ(account.gaps(), 1);
}

TEST(WatchedChannelTest, LatencyRunsFromTheMeasurementThatCausedIt) {
  TickTimes ticks;
  ticks.note(3, 1000);
  ticks.note(4, 2000);
  WatchedChannel account(Channel::kEstimate);
  EXPECT_FALSE(account.latency_us());
  take(account, 3, 1030, ticks);
  take(account, 4, 2050, ticks);
  take(account, 4100, 9000, ticks);  // its MEASUREMENT was not heard
  ASSERT_TRUE(account.latency_us());
  EXPECT_DOUBLE_EQ(*account.latency_us(), 40);
  EXPECT_DOUBLE_EQ(account.latency_max_us(), 50);
}

TEST(KeyValuesTest, ShowUnitsAndReportBytesThatDoNotDecode) {
  command_t command{};
  command.i_q_ref_A = 0.5;
  command.mode = 1;
  EXPECT_EQ(to_text(key_values(Channel::kCommand, encoded(command))),
            "omega_m_ref 0 rad/s  i_d_ref 0 A  i_q_ref 0.5 A  u_alpha 0 V  u_beta 0 V  align");
  EXPECT_FALSE(key_values(Channel::kTruth, encoded(command)).decoded);
}

}  // namespace
}  // namespace twinrate
