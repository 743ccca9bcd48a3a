#include "analysis/angle_sums.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "model/frames.hpp"

namespace twinrate {
namespace {

using Complex = std::complex<double>;

struct WeightedSamples {
  std::vector<double> theta, w, y;
};

// `count` angles from `begin` on, `step` apart on average; a negative one turns backwards.
WeightedSamples samples(int count, double begin, double step, double jitter = 0.3) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> drawn(-1, 1);
  WeightedSamples s;
  for (int i = 0; i < count; ++i) {
    s.theta.push_back(begin + step * (i + jitter * drawn(random)));
    s.w.push_back(1 + 0.5 * drawn(random));
    s.y.push_back(drawn(random) + std::cos(12 * s.theta.back()));
  }
  return s;
}

// Against the sums as they are defined, in long double.
void expect_the_sums(const WeightedSamples& s, int M, double tolerance) {
  const AngleSums sums = angle_sums(s.theta, s.w, s.y, M);
  ASSERT_EQ(sums.weights.size(), static_cast<std::size_t>(M) + 1);
  ASSERT_EQ(sums.values.size(), static_cast<std::size_t>(M) + 1);
  double of_weights = 0;
  for (const double w : s.w) of_weights += w;
  for (int m = 0; m <= M; ++m) {
    std::complex<long double> weights, values;
    for (std::size_t i = 0; i < s.theta.size(); ++i) {
      const auto power = std::polar<long double>(s.w[i], static_cast<long double>(m) * s.theta[i]);
      weights += power;
      values += power * static_cast<long double>(s.y[i]);
    }
    const auto at = static_cast<std::size_t>(m);
    EXPECT_LT(std::abs(sums.weights[at] - Complex(weights)), tolerance * of_weights) << "m " << m;
    EXPECT_LT(std::abs(sums.values[at] - Complex(values)), tolerance * of_weights) << "m " << m;
  }
}

TEST(AngleSums, AreThoseOfTheDefinition) {
  expect_the_sums(samples(3000, 0.2, 0.02), 120, 1e-14);
  expect_the_sums(samples(2000, 0, -0.013), 400, 1e-14);
  expect_the_sums(samples(5, -1, 0.7), 1, 1e-14);
  expect_the_sums(samples(5, 0, 0.7), 0, 1e-14);
}

// The angles themselves are rounded to 1e-12 there, m of them to 1e-10.
TEST(AngleSums, TakeAnglesOfManyTurns) {
  expect_the_sums(samples(2000, 1e4, 0.02), 120, 1e-11);
  expect_the_sums(samples(2000, -1e4, 0.02), 120, 1e-11);
}

// On the grid, and in the middle between two of its angles: d = -1 or 1.
TEST(AngleSums, TakeAnglesOfAnEncoder) {
  for (const double begin : {0.0, kPi / 512}) {
    WeightedSamples s = samples(1024, begin, kTwoPi / 512, 0);
    expect_the_sums(s, 120, 1e-14);
  }
}

}  // namespace
}  // namespace twinrate
