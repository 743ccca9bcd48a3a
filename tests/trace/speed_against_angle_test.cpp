#include "trace/speed_against_angle.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "model/frames.hpp"

namespace twinrate::speed_against_angle_test {

constexpr double kSampling_s = 1e-4;

struct Reading {
  double filter_s = 0;  // time constant
  double scale = 1;
  double swing = 60;  // rad/s
  double noise = 0;   // rad/s, before the filter
};

// 10 s of a speed that oscillates about a mean, read through a filter.
SpeedAgainstAngle::Difference compared(const Reading& reading) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  SpeedAgainstAngle compare;
  double filtered = 20;
  for (int k = 0; k < 100000; ++k) {
    const double t = k * kSampling_s, w = 5;
    const double omega_m = 20 + reading.swing * std::sin(w * t);
    const double theta_m = 20 * t + reading.swing / w * (1 - std::cos(w * t));
    const double read = omega_m + reading.noise * normal(random);
    const double keeps = reading.filter_s > 0 ? std::exp(-kSampling_s / reading.filter_s) : 0.0;
    filtered = keeps * filtered + (1 - keeps) * read;
    if (k % 5000 > 3) compare.add(t, wrap_pi(theta_m), reading.scale * filtered, kSampling_s);
  }
  return compare.difference();
}

TEST(SpeedAgainstAngle, FindsNothingIfTheyAgree) {
  for (const double noise : {0.0, 0.5}) {
    const auto d = compared({.noise = noise});
    EXPECT_EQ(d.lag_s, 0);
    EXPECT_EQ(d.scale, 1);
  }
}

TEST(SpeedAgainstAngle, FindsAFilter) {
  for (const double filter_s : {0.5e-3, 2e-3}) {
    // A filter in these steps lags by half a sample less.
    const auto d = compared({.filter_s = filter_s, .noise = 0.2});
    EXPECT_NEAR(d.lag_s, filter_s - 0.5 * kSampling_s, 0.02 * filter_s);
    EXPECT_EQ(d.scale, 1);
  }
}

TEST(SpeedAgainstAngle, FindsAnotherUnit) {
  const double rpm = 30 / kPi;
  const auto d = compared({.filter_s = 1e-3, .scale = rpm});
  EXPECT_NEAR(d.scale, rpm, 1e-3 * rpm);
  EXPECT_NEAR(d.lag_s, 0.95e-3, 0.02e-3);
}

TEST(SpeedAgainstAngle, ReportsNoLagThatIsNotIdentifiable) {
  EXPECT_EQ(compared({.filter_s = 1e-3, .swing = 0, .noise = 0.5}).lag_s, 0);
}

}  // namespace twinrate::speed_against_angle_test
