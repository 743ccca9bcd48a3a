// The disturbance learnt over the angle, in the whole drive with its reference disturbance set.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/ripple/ripple.hpp"

namespace twinrate::test {
namespace {

constexpr const char* kLearn = "controller.compensation=angle_domain";

Ripple off(double speed_rpm) {
  return ripple(speed_rpm, 2, 3, {"controller.compensation=off"});
}

// Learns for 30 turns; the figures are over the next 4.
Ripple learnt(double speed_rpm, std::vector<std::string> overrides = {}) {
  overrides.push_back(kLearn);
  return ripple(speed_rpm, 30 * 60 / speed_rpm, 4, overrides);
}

TEST(AngleDomainDrive, RemovesTheRippleAt50Rpm) {
  const Ripple before = off(50), after = learnt(50);
  EXPECT_LT(dB(after.rms / before.rms), -33);
  EXPECT_GT(dB(after.rms / before.rms), -60);
  EXPECT_LT(dB(after.harmonics / before.harmonics), -45);
}

TEST(AngleDomainDrive, RemovesTheRippleAt50RpmWithA17BitEncoder) {
  const Ripple after = learnt(50, {"sensors.encoder_counts=131072"});
  EXPECT_LT(dB(after.harmonics / off(50).harmonics), -45);
}

TEST(AngleDomainDrive, LearnsWithAnInertiaOffByThirtyPercent) {
  for (const double change_kgm2 : {-0.3 * 8.8e-3, 0.3 * 8.8e-3}) {
    const std::string effects = fmt::format(
        "effect=[{{kind=\"inertia\",change_kgm2={}}},"
        "{{kind=\"cogging\",order=18,amplitude_Nm=0.05}},"
        "{{kind=\"cogging\",order=54,amplitude_Nm=0.06}},"
        "{{kind=\"dead_time\",dead_time_s=1e-6}},"
        "{{kind=\"coulomb_friction\",torque_Nm=0.25}}]",
        change_kgm2);
    const Ripple before = ripple(50, 2, 3, {effects, "controller.compensation=off"});
    const Ripple after = learnt(50, {effects});
    EXPECT_LT(dB(after.rms / before.rms), -33) << change_kgm2;
  }
}

// Harmonic states of the filter estimate torque disturbances: nearly all of the ripple if all
// disturbances are mechanical.
TEST(HarmonicFilter, RemovesMechanicalRipple) {
  const std::string mechanical =
      "effect=[{kind=\"cogging\",order=6,amplitude_Nm=0.03},"
      "{kind=\"cogging\",order=18,amplitude_Nm=0.05,phase_rad=2.0},"
      "{kind=\"cogging\",order=54,amplitude_Nm=0.06,phase_rad=2.6},"
      "{kind=\"coulomb_friction\",torque_Nm=0.25}]";
  for (const double speed_rpm : {20.0, 50.0}) {
    const Ripple before = ripple(speed_rpm, 3, 3, {mechanical, "controller.compensation=off"});
    const Ripple after = ripple(speed_rpm, 3, 3, {mechanical, "estimator.kind=ekf_harmonic"});
    EXPECT_LT(after.rms / before.rms, 0.03) << speed_rpm;
  }
}

}  // namespace
}  // namespace twinrate::test
