#include "trace/parallel.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <numeric>
#include <stdexcept>
#include <vector>

namespace twinrate::parallel_test {
namespace {

TEST(ForEachIndex, CallsEachIndexOnce) {
  std::vector<int> calls(1000, 0);
  for_each_index(calls.size(), [&](std::size_t i) { ++calls[i]; });
  EXPECT_EQ(std::accumulate(calls.begin(), calls.end(), 0), 1000);
  EXPECT_EQ(calls, std::vector<int>(1000, 1));
  for_each_index(0, [&](std::size_t) { ADD_FAILURE() << "no index is below 0"; });
}

TEST(ForEachIndex, ThrowsWhatACallThrewAndStopsEarly) {
  std::atomic<int> calls = 0;
  const auto step = [&](std::size_t i) {
    ++calls;
    if (i == 3) throw std::runtime_error("step 3");
  };
  try {
    for_each_index(1'000'000, step);
    FAIL() << "nothing was thrown";
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "step 3");
  }
  EXPECT_LT(calls, 1'000'000);
}

}  // namespace
}  // namespace twinrate::parallel_test
