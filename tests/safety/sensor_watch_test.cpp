// SensorReadings that a healthy sensor cannot give, on a current vector that turns.
#include "safety/sensor_watch.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace twinrate::sensor_watch_test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kT_s = 2e-4, kAmplitude = 1.5;

SensorLimits limits() {
  return {.T_s = kT_s,
          .L = 5e-4,
          .R_s = 1.2,
          .psi_f = 0.007,
          .n_p = 4,
          .v_floor = 1.2,
          .i_floor = 0.3,
          .i_sum = 1.5,
          .i_moved = 0.6,
          .step_max = 0.3};
}

// The currents of a drive at 400 rad/s electrical, with the ripple of some noise.
class Turning {
 public:
  explicit Turning(double omega_e = 400) : omega_e_(omega_e) {}
  SensorReadings next() {
    theta_e_ += omega_e_ * kT_s;
    SensorReadings r;
    for (std::size_t p = 0; p < 3; ++p)
      r.i_abc[p] = kAmplitude * std::cos(theta_e_ - 2.0944 * static_cast<double>(p)) +
                   0.01 * std::sin(37.0 * theta_e_ + static_cast<double>(p));
    r.v_dc = 24;
    r.theta_m = theta_e_ / 4;
    r.omega_m = omega_e_ / 4;
    return r;
  }
  AppliedVoltage applied() const { return {.u = 4, .theta_e = theta_e_ - 0.3}; }

 private:
  double omega_e_, theta_e_ = 0;
};

double error_A(const SensorReadings& a, const SensorReadings& b) {
  double worst = 0;
  for (std::size_t p = 0; p < 3; ++p) worst = std::max(worst, std::abs(a.i_abc[p] - b.i_abc[p]));
  return worst;
}

TEST(SensorWatch, LeavesHealthyReadingsAsTheyAre) {
  SensorWatch watch(limits());
  Turning drive;
  for (int k = 0; k < 2000; ++k) {
    const SensorReadings truth = drive.next();
    SensorReadings r = truth;
    ASSERT_EQ(watch.check(r, drive.applied()), 0) << k;
    ASSERT_EQ(r.i_abc, truth.i_abc);
    ASSERT_EQ(r.theta_m, truth.theta_m);
  }
}

struct Case {
  const char* name;
  int fault;
  void (*spoil)(SensorReadings&);
};
class SpoiltReading : public testing::TestWithParam<Case> {};

// Held in rotor axes, the current of a steady drive stays right for 50 ticks.
TEST_P(SpoiltReading, IsFoundAtOncePredictedAndTakenAgainAfterwards) {
  SensorWatch watch(limits());
  Turning drive;
  SensorReadings r;
  for (int k = 0; k < 200; ++k) r = drive.next(), watch.check(r, drive.applied());
  for (int k = 0; k < 50; ++k) {
    const SensorReadings truth = drive.next();
    r = truth;
    GetParam().spoil(r);
    ASSERT_EQ(watch.check(r, drive.applied()), GetParam().fault) << k;
    EXPECT_LT(error_A(r, truth), 0.05);
    EXPECT_NEAR(r.theta_m, truth.theta_m, 1e-9);
    EXPECT_EQ(r.v_dc, 24);
  }
  r = drive.next();
  EXPECT_EQ(watch.check(r, drive.applied()), 0);
}

INSTANTIATE_TEST_SUITE_P(
    Table, SpoiltReading,
    testing::Values(
        Case{"CurrentNan", kCurrentsNotFinite, [](SensorReadings& r) { r.i_abc[1] = kNan; }},
        Case{"CurrentInfinite", kCurrentsNotFinite,
             [](SensorReadings& r) { r.i_abc[0] = HUGE_VAL; }},
        Case{"CurrentJump", kCurrentsJump, [](SensorReadings& r) { r.i_abc[0] += 20; }},
        Case{"SumOfThreePhases", kCurrentsJump, [](SensorReadings& r) { r.i_abc[2] += 2; }},
        Case{"BusNan", kBusNotFinite, [](SensorReadings& r) { r.v_dc = kNan; }},
        Case{"AngleNan", kPositionNotFinite, [](SensorReadings& r) { r.theta_m = kNan; }},
        Case{"AngleJump", kPositionJump, [](SensorReadings& r) { r.theta_m += 1; }}),
    [](const auto& row) { return row.param.name; });

int ticks_until_stuck(SensorWatch& watch, Turning& drive, bool all_phases, int most) {
  SensorReadings r;
  for (int k = 0; k < 200; ++k) r = drive.next(), watch.check(r, drive.applied());
  const SensorReadings frozen = r;
  for (int k = 1; k <= most; ++k) {
    r = drive.next();
    r.i_abc[0] = frozen.i_abc[0];
    if (all_phases) r.i_abc = frozen.i_abc;
    if (watch.check(r, drive.applied()) != 0) return k;
  }
  return -1;
}

TEST(SensorWatch, AStuckPhaseIsFoundWithinTwoRadiansOrByTheSum) {
  SensorWatch watch(limits());
  Turning drive;
  const int ticks = ticks_until_stuck(watch, drive, false, 100);
  EXPECT_GT(ticks, 1);
  EXPECT_LE(ticks, 26);  // 2 rad at 0.08 rad a tick
}

TEST(SensorWatch, ThreeStuckPhasesAreFoundWithinATurn) {
  SensorWatch watch(limits());
  Turning drive;
  const int ticks = ticks_until_stuck(watch, drive, true, 200);
  EXPECT_GT(ticks, 1);
  EXPECT_LE(ticks, 80);
}

// An ideal sensor at standstill repeats its reading for ever.
TEST(SensorWatch, AConstantCurrentAtStandstillIsNotStuck) {
  SensorWatch watch(limits());
  Turning drive(0);
  for (int k = 0; k < 5000; ++k) {
    SensorReadings r = drive.next();
    ASSERT_EQ(watch.check(r, drive.applied()), 0);
  }
}

TEST(SensorWatch, ARowWithoutASampleIsMissingAndTheNextIsTaken) {
  SensorWatch watch(limits());
  Turning drive;
  SensorReadings r;
  for (int k = 0; k < 50; ++k) r = drive.next(), watch.check(r, drive.applied());
  SensorReadings before = r;
  for (int k = 0; k < 5; ++k) {
    drive.next();
    EXPECT_EQ(watch.check(before, drive.applied(), false), kRowMissing);
  }
  r = drive.next();
  EXPECT_EQ(watch.check(r, drive.applied()), 0);
}

TEST(SensorWatch, AFirstReadingThatIsNotFiniteCountsAsZero) {
  SensorWatch watch(limits());
  SensorReadings r{{kNan, 0, 0}, kNan, kNan, 0};
  EXPECT_EQ(watch.check(r, {}), kCurrentsNotFinite | kBusNotFinite | kPositionNotFinite);
  EXPECT_EQ(r.i_abc[0], 0);
  EXPECT_EQ(r.theta_m, 0);
}

}  // namespace
}  // namespace twinrate::sensor_watch_test
