#include "analysis/order_spectrum.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>

#include "model/frames.hpp"

namespace twinrate {
namespace {

struct Samples {
  std::vector<double> theta_m, signal;
};

double two_orders(double theta_m) {
  return 0.7 + 0.05 * std::sin(12 * theta_m + 0.4) + 0.02 * std::sin(72 * theta_m - 1.1);
}

// theta_m(t) = omega t plus an oscillation of the speed by `swing` at just over 2 Hz.
Samples sample(double omega_m, double swing, double duration_s, double rate_Hz,
               const std::function<double(double)>& signal = two_orders) {
  Samples s;
  const int count = static_cast<int>(duration_s * rate_Hz);
  for (int i = 0; i < count; ++i) {
    const double t = i / rate_Hz;
    s.theta_m.push_back(0.3 + omega_m * (t + swing / 13.0 * (1 - std::cos(13.0 * t))));
    s.signal.push_back(signal(s.theta_m.back()));
  }
  return s;
}

// Orders 12 and 72 as generated, all others zero.
void expect_two_orders(const OrderSpectrum& spectrum, double tolerance) {
  ASSERT_GE(spectrum.amplitude.size(), 72u);
  EXPECT_NEAR(spectrum.mean, 0.7, tolerance);
  for (std::size_t i = 0; i < spectrum.amplitude.size(); ++i) {
    const std::size_t order = i + 1;
    const double expected = order == 12 ? 0.05 : order == 72 ? 0.02 : 0;
    EXPECT_NEAR(spectrum.amplitude[i], expected, tolerance) << "order " << order;
  }
  EXPECT_NEAR(spectrum.phase_rad[11], 0.4, 1e-3);
  EXPECT_NEAR(spectrum.phase_rad[71], -1.1, 1e-3);
}

TEST(OrderSpectrum, RecoversOrdersWithoutLeakageWhileTheSpeedVaries) {
  const Samples s = sample(12.0, 0.6, 3.0, 2000);
  const OrderSpectrum spectrum = order_spectrum(s.theta_m, s.signal, 100);
  EXPECT_EQ(spectrum.turns, 5);
  expect_two_orders(spectrum, 1e-9);
}

TEST(OrderSpectrum, GivesTheSamePhasesInEitherDirection) {
  const Samples s = sample(-12.0, 0.6, 3.0, 2000);
  const OrderSpectrum spectrum = order_spectrum(s.theta_m, s.signal, 100);
  EXPECT_EQ(spectrum.turns, 5);
  expect_two_orders(spectrum, 1e-9);
}

TEST(OrderSpectrum, IsExactWithJitterAndGaps) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Samples s;
  for (int i = 0; i < 6000; ++i) {
    if (i % 97 < 6 || (i > 2000 && i < 2060)) continue;
    const double theta_m = 0.006 * i + 0.02 * uniform(random);
    s.theta_m.push_back(theta_m);
    s.signal.push_back(two_orders(theta_m));
  }
  const OrderSpectrum spectrum = order_spectrum(s.theta_m, s.signal, 100);
  EXPECT_EQ(spectrum.turns, 5);
  expect_two_orders(spectrum, 1e-9);
}

TEST(OrderSpectrum, KeepsAmplitudesToAThousandthOnAQuantisedAngle) {
  Samples s = sample(12.0, 0.3, 3.0, 5000);
  const double step = kTwoPi / 20000;
  for (double& theta_m : s.theta_m) theta_m = std::floor(theta_m / step) * step;
  const OrderSpectrum spectrum = order_spectrum(s.theta_m, s.signal, 100);
  ASSERT_EQ(spectrum.amplitude.size(), 100u);
  EXPECT_NEAR(spectrum.amplitude[11], 0.05, 0.05e-3);
  EXPECT_NEAR(spectrum.amplitude[71], 0.02, 0.02e-3);
  EXPECT_LT(spectrum.amplitude[10], 1e-4);
  EXPECT_LT(spectrum.amplitude[12], 1e-4);
}

TEST(OrderSpectrum, OrdersBeyondTheFittedOnesDoNotLeakIn) {
  const Samples s = sample(12.0, 0.5, 3.0, 5000);
  const OrderSpectrum spectrum = order_spectrum(s.theta_m, s.signal, 60);
  ASSERT_EQ(spectrum.amplitude.size(), 60u);
  EXPECT_NEAR(spectrum.amplitude[11], 0.05, 0.05e-3);
  for (std::size_t i = 12; i < 60; ++i) EXPECT_LT(spectrum.amplitude[i], 2e-4) << "order " << i + 1;
}

TEST(OrderSpectrum, IsEmptyBelowOneTurnAndUsesTheLastWholeTurnsAboveIt) {
  const Samples less = sample(6.0, 0, 1.0, 1000);
  const OrderSpectrum none = order_spectrum(less.theta_m, less.signal, 10);
  EXPECT_EQ(none.turns, 0);
  EXPECT_TRUE(none.amplitude.empty());
  const Samples more = sample(6.0, 0, 2.6, 1000);
  const OrderSpectrum two = order_spectrum(more.theta_m, more.signal, 10);
  EXPECT_EQ(two.turns, 2);
  EXPECT_EQ(two.last, more.theta_m.size());
  EXPECT_NEAR(more.theta_m[two.last - 1] - more.theta_m[two.first], 2 * kTwoPi, 0.013);
}

TEST(OrderSpectrum, OfAReversalUsesTheLongerDirection) {
  Samples s;
  for (int i = 0; i < 9000; ++i) {
    const double theta_m = i < 3000 ? 0.004 * i : 12.0 - 0.004 * (i - 3000);
    s.theta_m.push_back(theta_m);
    s.signal.push_back(std::sin(3 * theta_m) + (i < 3000 ? 5 : 0));
  }
  const OrderSpectrum spectrum = order_spectrum(s.theta_m, s.signal, 10);
  EXPECT_EQ(spectrum.turns, 3);
  EXPECT_GE(spectrum.first, 3000u);
  EXPECT_NEAR(spectrum.mean, 0, 1e-9);
  EXPECT_NEAR(spectrum.amplitude[2], 1, 1e-9);
}

TEST(OrderSpectrum, IgnoresSamplesNotFiniteAndOrdersNotResolved) {
  Samples s = sample(12.0, 0, 3.0, 200);  // 105 samples a turn
  s.signal[50] = std::numeric_limits<double>::quiet_NaN();
  s.theta_m[90] = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < s.signal.size(); ++i)
    if (i != 50) s.signal[i] = std::sin(5 * s.theta_m[i]);
  s.signal[90] = 1;
  const OrderSpectrum spectrum = order_spectrum(s.theta_m, s.signal, 200);
  EXPECT_LT(spectrum.amplitude.size(), 53u);
  EXPECT_GT(spectrum.amplitude.size(), 40u);
  EXPECT_NEAR(spectrum.amplitude[4], 1, 1e-9);
}

TEST(OrderSpectrum, RmsIsThatOfTheRequestedOrders) {
  OrderSpectrum spectrum;
  spectrum.amplitude = {3, 4, 100};
  EXPECT_NEAR(spectrum.rms(2), 5 / std::sqrt(2.0), 1e-12);
}

TEST(OrderSpectrum, WithoutSamplesIsEmpty) {
  EXPECT_EQ(order_spectrum({}, {}, 5).turns, 0);
  const std::vector<double> still(100, 1.0);
  EXPECT_EQ(order_spectrum(still, still, 5).turns, 0);
}

// Two shapes with one of two orders in common.
TEST(OrderSpectrum, ShapeCorrelationIsThatOfTheSignals) {
  const std::size_t count = 5000;
  std::vector<double> theta_m(count), first(count), second(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double theta = kTwoPi * static_cast<double>(i) / static_cast<double>(count);
    theta_m[i] = theta;
    first[i] = 5 + 3 * std::sin(2 * theta) + std::sin(7 * theta + 0.3);
    second[i] = -1 + 2 * std::sin(2 * theta + 0.4) + 4 * std::cos(9 * theta);
  }
  const OrderSpectrum a = order_spectrum(theta_m, first, 20);
  const OrderSpectrum b = order_spectrum(theta_m, second, 20);
  double ab = 0, aa = 0, bb = 0;  // oracle: the sums over the samples themselves
  for (std::size_t i = 0; i < count; ++i) {
    ab += (first[i] - 5) * (second[i] + 1);
    aa += (first[i] - 5) * (first[i] - 5);
    bb += (second[i] + 1) * (second[i] + 1);
  }
  EXPECT_NEAR(shape_correlation(a, b, 20), ab / std::sqrt(aa * bb), 1e-9);
  EXPECT_NEAR(shape_correlation(a, a, 20), 1, 1e-12);
  EXPECT_NEAR(shape_correlation(b, b, 20, kTwoPi / 18), (4 * std::cos(2 * kTwoPi / 18) - 16) / 20,
              1e-9);
  EXPECT_NEAR(a.at(0.5, 20), 3 * std::sin(1.0) + std::sin(3.8), 1e-9);
}

// The amplitudes of white noise of variance 1 are Rayleigh distributed with sigma = sqrt(2/count).
TEST(OrderSpectrum, NoiseIsTheMedianAmplitude) {
  const std::size_t count = 20000;
  std::vector<double> theta_m(count), signal(count);
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  for (std::size_t i = 0; i < count; ++i) {
    theta_m[i] = 4 * kTwoPi * static_cast<double>(i) / static_cast<double>(count);
    signal[i] = normal(random) + std::sin(11 * theta_m[i]);
  }
  const OrderSpectrum spectrum = order_spectrum(theta_m, signal, 200);
  const double expected = std::sqrt(2 / static_cast<double>(count)) * std::sqrt(2 * std::log(2.0));
  EXPECT_GT(spectrum.noise(200), 0.85 * expected);
  EXPECT_LT(spectrum.noise(200), 1.15 * expected);
  for (std::size_t N = 1; N <= 200; ++N)
    EXPECT_EQ(spectrum.amplitude[N - 1] > kDetectionRatio * spectrum.noise(200), N == 11) << N;
}

}  // namespace
}  // namespace twinrate
