#include "run/hop_latency.hpp"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace twinrate
