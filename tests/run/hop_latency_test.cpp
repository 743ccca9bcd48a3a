#include "run/hop_latency.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <lcm/lcm-cpp.hpp>

#include "core/signals_io.hpp"

namespace twinrate {
namespace {

TEST(HopLatency, APercentileIsTheSmallestSampleThatIsNotBelowTheShare) {
  std::vector<double> samples;
  for (int i = 1000; i >= 1; --i) samples.push_back(i);
  const Percentiles found = percentiles_of(samples);
  EXPECT_EQ(found.p50, 500);
  EXPECT_EQ(found.p99, 990);
  EXPECT_EQ(found.p99_9, 999);
  EXPECT_EQ(found.max, 1000);
  std::vector<double> one = {7};
  EXPECT_EQ(percentiles_of(one).p50, 7);
  EXPECT_EQ(percentiles_of(one).p99_9, 7);
}

TEST(HopLatency, ALogWithoutHostTimesHasNone) {
  const std::string log = std::string(TWINRATE_SOURCE_DIR) + "/tests/core/schema_4.lcm";
  EXPECT_EQ(hop_latencies(log).rounds, 0);
  std::vector<double> none;
  EXPECT_EQ(percentiles_of(none).max, 0);
}

// Three hosts whose clocks are wrong by 1, 20 and 300 ms.
TEST(HopLatency, TheClocksOfTheHostsAreTakenOut) {
  char pattern[] = "/tmp/hop-latency-XXXXXX";
  const std::string directory = mkdtemp(pattern), path = directory + "/log.lcm";
  const ClockOffsets clocks{
      .plant_ns = 1'000'000, .estimator_ns = 20'000'000, .controller_ns = 300'000'000};
  {
    lcm::LogFile log(path, "w");
    const auto put = [&](const char* channel, auto message, std::int64_t k, std::int64_t host_ns) {
      message.seq = k;
      message.host_ns = host_ns;
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
      message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      lcm::LogEvent event{.eventnum = 0,
                          .timestamp = k,
                          .channel = channel,
                          .datalen = static_cast<int>(bytes.size()),
                          .data = bytes.data()};
      log.writeEvent(&event);
    };
    for (std::int64_t k = 0; k < 100; ++k) {
      const std::int64_t t = 1'000'000'000 + 200'000 * k;
      put("DRIVE_MEASUREMENT", measurement_t{}, k, t + clocks.plant_ns);
      put("DRIVE_ESTIMATE", estimate_t{}, k, t + 40'000 + clocks.estimator_ns);
      put("DRIVE_COMMAND", command_t{}, k, t + 70'000 + clocks.controller_ns);
    }
  }
  const HopLatencies found = hop_latencies(path, clocks);
  std::filesystem::remove_all(directory);
  EXPECT_EQ(found.rounds, 100);
  EXPECT_NEAR(found.to_estimate_us.p50, 40, 0.5);  // bins of 1.1 %
  EXPECT_NEAR(found.to_command_us.p50, 30, 0.4);
  EXPECT_NEAR(found.round_us.max, 70, 0.8);
}

}  // namespace
}  // namespace twinrate
