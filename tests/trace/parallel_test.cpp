#include "trace/parallel.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <numeric>
#include <set>
#include <stdexcept>
#include <thread>
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

TEST(ForEachIndex, AStepInsideAStepStartsNoMoreThreadsThanThereAreCpus) {
  std::atomic<int> working = 0, most = 0, calls = 0;
  for_each_index(6, [&](std::size_t) {
    for_each_index(6, [&](std::size_t) {
      for (int now = ++working, before = most; now > before;)
        if (most.compare_exchange_weak(before, now)) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      --working, ++calls;
    });
  });
  EXPECT_EQ(calls, 36);
  EXPECT_LE(most, static_cast<int>(std::thread::hardware_concurrency()));
  // Both levels give their threads back: a later step is parallel again.
  std::set<std::thread::id> threads;
  std::mutex guard;
  for_each_index(64, [&](std::size_t) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    const std::lock_guard lock(guard);
    threads.insert(std::this_thread::get_id());
  });
  if (std::thread::hardware_concurrency() > 1) {
    EXPECT_GT(threads.size(), 1U);
  }
}

TEST(Together, RunsEveryStep) {
  int a = 0, b = 0, c = 0;
  together({[&] { a = 1; }, [&] { b = 2; }, [&] { c = 3; }});
  EXPECT_EQ(a + 10 * b + 100 * c, 321);
}

}  // namespace
}  // namespace twinrate::parallel_test
