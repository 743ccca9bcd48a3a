#include "run/hop_latency.hpp"

#include <fmt/format.h>
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

// A log of MEASUREMENT, ESTIMATE and COMMAND with host times.
class LogOfTimes {
 public:
  LogOfTimes() : directory_(mkdtemp(pattern_)), log_(path(), "w") {}
  ~LogOfTimes() { std::filesystem::remove_all(directory_); }
  std::string path() const { return directory_ + "/log.lcm"; }
  template <class Message>
  void put(const char* channel, std::int64_t k, std::int64_t host_ns) {
    Message message{};
    message.seq = k;
    message.host_ns = host_ns;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    lcm::LogEvent event{.eventnum = 0,
                        .timestamp = k,
                        .channel = channel,
                        .datalen = static_cast<int>(bytes.size()),
                        .data = bytes.data()};
    log_.writeEvent(&event);
    fflush(log_.getFilePtr());
  }

 private:
  char pattern_[32] = "/tmp/hop-latency-XXXXXX";
  std::string directory_;
  lcm::LogFile log_;
};

std::int64_t begin_ns(std::int64_t k) {
  return 1'000'000'000 + 200'000 * k;
}

// Three hosts whose clocks are wrong by 1, 20 and 300 ms.
TEST(HopLatency, TheClocksOfTheHostsAreTakenOut) {
  const ClockOffsets clocks{
      .plant_ns = 1'000'000, .estimator_ns = 20'000'000, .controller_ns = 300'000'000};
  LogOfTimes log;
  for (std::int64_t k = 0; k < 100; ++k) {
    log.put<measurement_t>("DRIVE_MEASUREMENT", k, begin_ns(k) + clocks.plant_ns);
    log.put<estimate_t>("DRIVE_ESTIMATE", k, begin_ns(k) + 40'000 + clocks.estimator_ns);
    log.put<command_t>("DRIVE_COMMAND", k, begin_ns(k) + 70'000 + clocks.controller_ns);
  }
  const HopLatencies found = hop_latencies(log.path(), clocks);
  EXPECT_EQ(found.rounds, 100);
  EXPECT_NEAR(found.to_estimate_us.p50, 40, 0.5);  // bins of 1.1 %
  EXPECT_NEAR(found.to_command_us.p50, 30, 0.4);
  EXPECT_NEAR(found.round_us.max, 70, 0.8);
  const auto slow = slowest_answer(log.path(), 99, clocks);
  ASSERT_TRUE(slow);
  EXPECT_EQ(slow->role, Role::kEstimator);
  EXPECT_NEAR(slow->ms, 0.04, 1e-9);
}

// A process stands from tick 150 on. The other one waits for it and is not named.
TEST(SlowestAnswer, NamesTheProcessThatKeptTheTickWaiting) {
  for (const bool controller : {true, false})
    for (const bool comes_back : {true, false}) {
      LogOfTimes log;
      for (std::int64_t k = 0; k < 250; ++k) {
        log.put<measurement_t>("DRIVE_MEASUREMENT", k, begin_ns(k));
        const bool stands = k >= 150 && k < 180;
        if (stands && !comes_back && !controller) continue;
        const std::int64_t resumes_ns = begin_ns(180);
        const std::int64_t estimate_ns = stands && !controller ? resumes_ns : begin_ns(k) + 40'000;
        log.put<estimate_t>("DRIVE_ESTIMATE", k, estimate_ns);
        if (stands && !comes_back) continue;
        log.put<command_t>("DRIVE_COMMAND", k,
                           std::max(estimate_ns, stands ? resumes_ns : 0) + 30'000);
      }
      const auto slow = slowest_answer(log.path(), 170);
      ASSERT_TRUE(slow);
      EXPECT_EQ(slow->role, controller ? Role::kController : Role::kEstimator);
      EXPECT_EQ(slow->k, 150);
      EXPECT_EQ(slow->came, comes_back);
      EXPECT_NEAR(slow->ms, comes_back ? 6 : 4, 0.1);
      EXPECT_EQ(text_of(*slow),
                fmt::format("the {} {}", controller ? "controller" : "estimator",
                            comes_back   ? controller ? "answered ESTIMATE(150) after 6.0 ms"
                                                      : "answered MEASUREMENT(150) after 6.0 ms"
                            : controller ? "did not answer ESTIMATE(150) within 4.0 ms"
                                         : "did not answer MEASUREMENT(150) within 4.0 ms"));
    }
}

}  // namespace
}  // namespace twinrate
