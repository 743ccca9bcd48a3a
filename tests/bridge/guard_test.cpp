// The host's own protection over samples that a drive could send.
#include "bridge/guard.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

constexpr double kTrip_A = 10;

BridgeGuard guard_of(std::vector<std::string> more = {}) {
  more.insert(more.end(), {"plant.kind=bridge", "machine.i_trip_A=10"});
  Config config = load_drive("dilys2021", more);
  return {config, config.read<BridgeParameters>()};
}

// A sample of an idle drive whose current vector has this amplitude along the beta axis.
DriveSample sample_of(std::int64_t k, double i_beta) {
  DriveSample s;
  s.m.k = k;
  s.m.signals = kPhaseCurrents | kBusVoltage | kPosition;
  const double half = 0.5 * std::sqrt(3.0) * i_beta;
  s.m.i_abc = {0, half, -half};
  s.m.v_dc = 24;
  return s;
}

// Slower than a jump: 2 % of the limit a tick.
TEST(BridgeGuard, SwitchesOffAtTheAmplitudeOfTheCurrentVector) {
  BridgeGuard guard = guard_of();
  double i = 0;
  for (std::int64_t k = 0; k < 200 && !guard.is_off(); ++k) {
    i += 0.02 * kTrip_A;
    guard.take(sample_of(k, i), Arrival::kInTime, Mode::kRun);
  }
  ASSERT_TRUE(guard.is_off());
  EXPECT_GT(i, kTrip_A);
  EXPECT_LT(i, 1.05 * kTrip_A);  // two ticks
  ASSERT_EQ(guard.take_events().front().reason, Reason::kOverCurrent);
}

TEST(BridgeGuard, ALostAngleCountsOnlyWhereTheControllerUsesIt) {
  const auto off_without_angle = [](BridgeGuard guard) {
    for (std::int64_t k = 0; k < 200; ++k) {
      DriveSample s = sample_of(k, 0.1);
      if (k > 10) s.m.theta_m = std::numeric_limits<double>::quiet_NaN();
      guard.take(s, Arrival::kInTime, Mode::kRun);
    }
    return guard.is_off();
  };
  EXPECT_FALSE(off_without_angle(guard_of()));
  EXPECT_TRUE(off_without_angle(guard_of({"controller.angle_source=measured"})));
}

// As the simulated drive: the processes get a prediction and predict, and the drive is off when it lasts.
TEST(BridgeGuard, AnImplausibleReadingIsPredictedAndSwitchesOffWhenItLasts) {
  for (const double misread : {10.0, std::numeric_limits<double>::quiet_NaN()}) {
    BridgeGuard guard = guard_of();
    for (std::int64_t k = 0; k < 100; ++k) {
      const Measurement m = guard.take(sample_of(k, 0.1), Arrival::kInTime, Mode::kRun);
      EXPECT_NE(m.signals & kPhaseCurrents, 0);
    }
    int ticks = 0;
    for (std::int64_t k = 100; k < 200 && !guard.is_off(); ++k, ++ticks) {
      DriveSample s = sample_of(k, 0.1);
      s.m.i_abc[0] += misread;
      const Measurement m = guard.take(s, Arrival::kInTime, Mode::kRun);
      EXPECT_EQ(m.signals & kPhaseCurrents, 0);
      EXPECT_NEAR(m.i_abc[0], 0, 0.2);
    }
    EXPECT_NEAR(ticks, 51, 1) << "safety.sensor_ticks = 50";
    const auto events = guard.take_events();
    ASSERT_EQ(events.size(), 2u);
    EXPECT_EQ(events[0].reason, Reason::kSensorFault);
    EXPECT_EQ(events[1].reason, Reason::kSensorLost);
  }
}

}  // namespace
}  // namespace twinrate
