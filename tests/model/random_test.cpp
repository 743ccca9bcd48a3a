#include "model/random.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

namespace twinrate {
namespace {

constexpr int kSamples = 200000;

TEST(Splitmix64, GivesThePublishedSequence) {
  // The generator with state 0 puts out mix(1 golden), mix(2 golden), .. (Vigna, splitmix64.c).
  EXPECT_EQ(splitmix64(0), 0xe220a8397b1dcdafULL);
  EXPECT_EQ(splitmix64(0x9e3779b97f4a7c15ULL), 0x6e789e6aa1b965f4ULL);
  EXPECT_EQ(splitmix64(2 * 0x9e3779b97f4a7c15ULL), 0x06c45d188009454fULL);
}

TEST(Uniform, FillsTheIntervalEvenlyAndNeverGivesZero) {
  double sum = 0, square_sum = 0, smallest = 1, largest = 0;
  for (int i = 0; i < kSamples; ++i) {
    const double u = uniform(1, 0, static_cast<std::uint64_t>(i));
    sum += u;
    square_sum += u * u;
    smallest = std::min(smallest, u);
    largest = std::max(largest, u);
  }
  // Mean 1/2 and variance 1/12, each within five standard errors.
  EXPECT_NEAR(sum / kSamples, 0.5, 5 * std::sqrt(1.0 / 12 / kSamples));
  EXPECT_NEAR(square_sum / kSamples, 1.0 / 3, 5 * std::sqrt(4.0 / 45 / kSamples));
  EXPECT_GT(smallest, 0);
  EXPECT_LE(largest, 1);
}

TEST(Normal, HasTheMomentsOfTheStandardNormal) {
  double m1 = 0, m2 = 0, m3 = 0, m4 = 0;
  for (int i = 0; i < kSamples; ++i) {
    const double z = normal(42, 3, static_cast<std::uint64_t>(i));
    m1 += z, m2 += z * z, m3 += z * z * z, m4 += z * z * z * z;
  }
  const double n = kSamples;
  // Variances of the moments: 1, 2, 15, 96 over n; five standard errors.
  EXPECT_NEAR(m1 / n, 0, 5 * std::sqrt(1 / n));
  EXPECT_NEAR(m2 / n, 1, 5 * std::sqrt(2 / n));
  EXPECT_NEAR(m3 / n, 0, 5 * std::sqrt(15 / n));
  EXPECT_NEAR(m4 / n, 3, 5 * std::sqrt(96 / n));
}

TEST(Normal, StreamsSeedsAndNeighboursAreUncorrelated) {
  double streams = 0, seeds = 0, neighbours = 0;
  for (int i = 0; i < kSamples; ++i) {
    const auto k = static_cast<std::uint64_t>(i);
    const double z = normal(7, 0, k);
    streams += z * normal(7, 1, k);
    seeds += z * normal(8, 0, k);
    neighbours += z * normal(7, 0, k + 1);
  }
  const double bound = 5 * std::sqrt(static_cast<double>(kSamples));
  EXPECT_LT(std::abs(streams), bound);
  EXPECT_LT(std::abs(seeds), bound);
  EXPECT_LT(std::abs(neighbours), bound);
}

TEST(ThreeNormals, AreBitForBitThreeTimesNormal) {
  ThreeNormals three(6, 3);
  const auto expect_at = [&](std::uint64_t index) {
    const auto z = three(index);
    for (std::uint64_t l = 0; l < 3; ++l) ASSERT_EQ(z[l], normal(6, 3 + l, index)) << index;
  };
  for (std::uint64_t k = 0; k < 20000; ++k) {
    expect_at(k);
    if (k % 7 == 0) expect_at(k * k);  // elsewhere, and back
  }
  for (std::uint64_t back = 1; back < 20; ++back) expect_at(0 - back);
}

TEST(Normal, IsAPureFunctionOfItsArguments) {
  const double first = normal(5, 2, 1000);
  for (std::uint64_t k = 0; k < 100; ++k) normal(9, 1, k);
  EXPECT_EQ(normal(5, 2, 1000), first);
}

}  // namespace
}  // namespace twinrate
