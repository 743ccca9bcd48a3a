#include "model/sensors.hpp"

#include <gtest/gtest.h>

#include <algorithm>

namespace twinrate::sensors_test {
namespace {

constexpr int kSamples = 100000;

TEST(PhaseCurrents, NoiseHasTheStatedRmsOnEachPhaseAndNoMean) {
  const SensorParameters p{.i_noise_rms = 0.0245};
  const Vec3 i_abc(1.0, -0.25, -0.75);
  Vec3 sum = Vec3::Zero(), square_sum = Vec3::Zero();
  for (int k = 0; k < kSamples; ++k) {
    const Vec3 noise = sample_currents(p, i_abc, 3, k) - i_abc;
    sum += noise;
    square_sum += noise.cwiseProduct(noise);
  }
  for (int phase = 0; phase < 3; ++phase) {
    EXPECT_NEAR(sum[phase] / kSamples, 0, 5 * 0.0245 / std::sqrt(kSamples));
    EXPECT_NEAR(std::sqrt(square_sum[phase] / kSamples), 0.0245,
                5 * 0.0245 / std::sqrt(2.0 * kSamples));
  }
}

TEST(PhaseCurrents, TheDilysNoiseIsTwentyMilliampereOnAlphaAndBeta) {
  const SensorParameters p{.i_noise_rms = 0.0245};
  Vec2 square_sum = Vec2::Zero();
  for (int k = 0; k < kSamples; ++k) {
    const Vec2 noise = clarke(sample_currents(p, Vec3::Zero(), 11, k));
    square_sum += noise.cwiseProduct(noise);
  }
  // A phase's noise times sqrt(2/3) on either axis.
  EXPECT_NEAR(std::sqrt(square_sum[0] / kSamples), 0.020, 0.0002);
  EXPECT_NEAR(std::sqrt(square_sum[1] / kSamples), 0.020, 0.0002);
}

TEST(PhaseCurrents, PhasesAreIndependent) {
  const SensorParameters p{.i_noise_rms = 1};
  double ab = 0, bc = 0;
  for (int k = 0; k < kSamples; ++k) {
    const Vec3 noise = sample_currents(p, Vec3::Zero(), 4, k);
    ab += noise[0] * noise[1];
    bc += noise[1] * noise[2];
  }
  EXPECT_LT(std::abs(ab / kSamples), 5 / std::sqrt(kSamples));
  EXPECT_LT(std::abs(bc / kSamples), 5 / std::sqrt(kSamples));
}

TEST(PhaseCurrents, TheAdcRoundsToTheNearestStep) {
  const SensorParameters p{.i_lsb = 0.004};
  const Vec3 i_meas = sample_currents(p, {0.0019, 0.0021, -0.0099}, 1, 0);
  EXPECT_NEAR(i_meas[0], 0.000, 1e-15);
  EXPECT_NEAR(i_meas[1], 0.004, 1e-15);
  EXPECT_NEAR(i_meas[2], -0.008, 1e-15);  // -2.475 steps
  for (int i = -500; i < 500; ++i) {
    const double steps = sample_currents(p, Vec3::Constant(i * 1.37e-4), 1, i)[0] / 0.004;
    EXPECT_NEAR(steps, std::round(steps), 1e-9);
    EXPECT_LE(std::abs(steps * 0.004 - i * 1.37e-4), 0.002 + 1e-12);
  }
}

TEST(PhaseCurrents, AnIdealSensorPassesTheCurrentsUnchanged) {
  const Vec3 i_abc(0.1234, 5, -3);
  EXPECT_EQ(sample_currents({}, i_abc, 99, 7), i_abc);
}

TEST(PhaseCurrents, ASampleDependsOnSeedAndIndexAlone) {
  const SensorParameters p{.i_noise_rms = 0.1};
  const Vec3 first = sample_currents(p, Vec3::Zero(), 5, 1234);
  for (int k = 0; k < 50; ++k) sample_currents(p, Vec3::Zero(), 6, k);
  EXPECT_EQ(sample_currents(p, Vec3::Zero(), 5, 1234), first);
  EXPECT_NE(sample_currents(p, Vec3::Zero(), 6, 1234), first);
  EXPECT_NE(sample_currents(p, Vec3::Zero(), 5, 1235), first);
}

TEST(Encoder, FloorsToItsCount) {
  const SensorParameters p{.encoder_counts = 1000};
  const double step = kTwoPi / 1000;
  EXPECT_NEAR(sample_angle(p, 2.999 * step), 2 * step, 1e-12);
  EXPECT_NEAR(sample_angle(p, 3.001 * step), 3 * step, 1e-12);
  EXPECT_NEAR(sample_angle(p, -0.001 * step), -step, 1e-12);                // floor, not truncation
  EXPECT_NEAR(sample_angle(p, 5 * kTwoPi + 0.5 * step), 5 * kTwoPi, 1e-9);  // unwrapped
}

TEST(Encoder, ErrorIsOneSidedAndSmallerThanACount) {
  const SensorParameters p{.encoder_counts = 4096};
  const double step = kTwoPi / 4096;
  double largest = 0;
  for (int i = 0; i < 5000; ++i) {
    const double theta_m = -3 + i * 1.2345e-3, error = theta_m - sample_angle(p, theta_m);
    EXPECT_GE(error, -1e-12);
    EXPECT_LT(error, step + 1e-12);
    largest = std::max(largest, error);
  }
  EXPECT_GT(largest, 0.99 * step);
}

TEST(Encoder, ZeroCountsIsTheExactAngle) {
  EXPECT_EQ(sample_angle({}, 1.23456789), 1.23456789);
}

}  // namespace
}  // namespace twinrate::sensors_test
