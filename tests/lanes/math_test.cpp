// The engine's own sine, logarithm and noise against the library's and against model/random.hpp.
#include "lanes/math.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "model/frames.hpp"
#include "model/random.hpp"

namespace twinrate::lanes {
namespace {

using Row = Lanes<1, struct LaneMathTest>;
using Pair = Lanes<2, struct LaneMathTest>;

TEST(LaneMath, SineAndCosineAreTheLibrarysToAnUlp) {
  double worst = 0;
  for (std::uint64_t i = 0; i < 20000; ++i) {
    const double x = 100 * twinrate::normal(1, 0, i);
    const auto at = sincos(Row(x));
    worst = std::max({worst, std::abs(at.sin.v - std::sin(x)), std::abs(at.cos.v - std::cos(x))});
  }
  EXPECT_LT(worst, 2.3e-16);
  EXPECT_GT(worst, 0);  // 0 if nothing were compared
}

TEST(LaneMath, SineIsRightInEveryQuadrant) {
  for (int k = -8; k <= 8; ++k) {
    const auto at = sincos(Row(k * kPi / 2));
    EXPECT_NEAR(at.sin.v, k % 2 == 0 ? 0 : (k % 4 == 1 || k % 4 == -3 ? 1 : -1), 1e-15) << k;
    EXPECT_NEAR(at.cos.v, k % 2 != 0 ? 0 : (k % 4 == 0 ? 1 : -1), 1e-15) << k;
  }
}

TEST(LaneMath, LogarithmIsTheLibrarysToAnUlpFromTheSmallestUniformToOne) {
  for (std::uint64_t i = 0; i < 20000; ++i) {
    const double u = std::pow(twinrate::uniform(2, 0, i), 1 + static_cast<double>(i % 40));
    ASSERT_NEAR(log(Row(u)).v, std::log(u), 3e-16 * std::abs(std::log(u))) << u;
  }
  EXPECT_EQ(log(Row(1.0)).v, 0);
  EXPECT_NEAR(log(Row(0x1p-53)).v, -53 * std::log(2.0), 1e-14);
}

TEST(LaneMath, UniformIsThatOfTheModelToTheLastBit) {
  for (std::uint64_t b : {0x0u, 0x7ffu, 0x800u, 0xfffu, 0x1000u, 0x1800u})
    for (std::uint64_t top : {0ull, 0x123456789abull << 20, ~0ull << 13}) {
      const std::uint64_t bits = top | b;
      EXPECT_EQ(uniform_of<Row>(bits).v, static_cast<double>((bits >> 11) + 1) * 0x1p-53) << bits;
      EXPECT_NEAR(cos_of_turn<Row>(bits).v, std::cos(kTwoPi * uniform_of<Row>(bits).v), 2e-15);
    }
}

TEST(LaneMath, RoundsToEvenAndWrapsToPi) {
  for (double x : {-2.5, -1.5, -0.5, 0.5, 1.5, 2.5}) {
    EXPECT_EQ(round_to_even(Row(x)).v, std::nearbyint(x));
  }
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const double angle = 50 * twinrate::normal(3, 0, i);
    EXPECT_NEAR(wrap_pi(Row(angle)).v, twinrate::wrap_pi(angle), 1e-13);
  }
}

TEST(LaneMath, TheNoiseIsThatOfTheModel) {
  for (std::uint64_t seed : {1u, 7u})
    for (std::uint64_t stream = 0; stream < 3; ++stream) {
      const auto hash = [&](std::uint64_t half) {
        return Row(std::bit_cast<double>(
            twinrate::splitmix64(twinrate::splitmix64(seed) ^ (2 * stream + half))));
      };
      for (std::uint64_t k = 0; k < 5000; ++k)
        ASSERT_NEAR(normal(hash(0), hash(1), k).v, twinrate::normal(seed, stream, k), 1e-13);
    }
}

TEST(LaneMath, ALaneComputesWhatANumberAloneDoes) {
  for (std::uint64_t i = 0; i < 5000; ++i) {
    const double x = 30 * twinrate::normal(4, 0, i), y = twinrate::uniform(4, 5, i);
    Pair both(0.0);
    both.v[0] = 1.0, both.v[1] = x;
    EXPECT_EQ(sincos(both).sin.v[1], sincos(Row(x)).sin.v);
    EXPECT_EQ(sincos(both).cos.v[1], sincos(Row(x)).cos.v);
    both.v[1] = y;
    EXPECT_EQ(log(both).v[1], log(Row(y)).v);
    EXPECT_EQ(sqrt(both).v[1], std::sqrt(y));
    const Pair::Bits bits{i, i << 40};
    EXPECT_EQ(cos_of_turn<Pair>(bits).v[1], cos_of_turn<Row>(i << 40).v);
    EXPECT_EQ(uniform_of<Pair>(bits).v[1], uniform_of<Row>(i << 40).v);
  }
}

}  // namespace
}  // namespace twinrate::lanes
