// Statistics of a channel from headers alone: gaps, repeats, rates and latencies.
#include <gtest/gtest.h>

#include "tools/watch/key_values.hpp"
#include "tools/watch/watched_channel.hpp"

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

TEST(WatchedChannelTest, AGainEveryNthTickIsNoGap) {
  WatchedChannel account(Channel::kGain);
  for (const int seq : {0, 5, 10, 25, 30}) take(account, seq, seq);
  EXPECT_EQ(account.gaps(), 2);
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
