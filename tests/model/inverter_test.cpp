#include "model/inverter.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include "tests/support/angles.hpp"

namespace twinrate {
namespace {

constexpr double kVdc = 24;

Vec2 at_angle(double amplitude, double angle) {
  return {amplitude * std::cos(angle), amplitude * std::sin(angle)};
}

// The hexagon by elementary geometry: flats at v_dc/sqrt3 from the centre, corners on the phase
// axes.
double hexagon_radius(double angle) {
  const double from_flat = std::fmod(angle + kTwoPi, kPi / 3) - kPi / 6;
  return kVdc / std::sqrt(3.0) / std::cos(from_flat);
}

// Mean phase-to-neutral voltage of the legs, from the duties alone.
Vec2 mean_voltage(const Vec3& duty) {
  const double mean = duty.sum() / 3;
  const Vec3 u_abc = kVdc * (duty - Vec3::Constant(mean));
  return {u_abc[0], (u_abc[1] - u_abc[2]) / std::sqrt(3.0)};
}

TEST(Svpwm, MeanVoltageIsTheReferenceInsideTheHexagon) {
  for (double angle : test::angles_over_a_turn(360)) {
    for (double share : {0.0, 0.3, 0.9, 0.999}) {
      const Vec2 u_ref = at_angle(share * hexagon_radius(angle), angle);
      const InverterOutput out = svpwm(u_ref, kVdc);
      EXPECT_FALSE(out.limited);
      EXPECT_NEAR((out.u_alphabeta - u_ref).norm(), 0, 1e-12);
      EXPECT_NEAR((mean_voltage(out.duty_abc) - u_ref).norm(), 0, 1e-12);
    }
  }
}

TEST(Svpwm, OutsideTheHexagonTheVoltageLandsOnItsEdgeAndKeepsItsAngle) {
  for (double angle : test::angles_over_a_turn(360)) {
    for (double share : {1.001, 1.5, 20.0}) {
      const InverterOutput out = svpwm(at_angle(share * hexagon_radius(angle), angle), kVdc);
      EXPECT_TRUE(out.limited);
      EXPECT_NEAR(out.u_alphabeta.norm(), hexagon_radius(angle), 1e-11);
      EXPECT_NEAR(wrap_pi(std::atan2(out.u_alphabeta[1], out.u_alphabeta[0]) - angle), 0, 1e-12);
      EXPECT_NEAR((mean_voltage(out.duty_abc) - out.u_alphabeta).norm(), 0, 1e-12);
    }
  }
}

TEST(Svpwm, EveryAngleReachesTheLinearLimitAndNoneBetweenTheCornersPassesIt) {
  const InverterParameters p{.v_dc = kVdc};
  EXPECT_NEAR(p.u_max_linear(), 13.8564, 1e-4);  // 24/sqrt3
  for (double angle : test::angles_over_a_turn(720))
    EXPECT_FALSE(svpwm(at_angle(0.99999 * p.u_max_linear(), angle), kVdc).limited);
  EXPECT_TRUE(svpwm(at_angle(1.00001 * p.u_max_linear(), kPi / 6), kVdc).limited);
}

TEST(Svpwm, TheCornerGivesTwoThirdsOfTheBus) {
  const InverterOutput out = svpwm({100, 0}, kVdc);
  EXPECT_NEAR(out.u_alphabeta[0], 16.0, 1e-12);
  EXPECT_NEAR(out.u_alphabeta[1], 0, 1e-12);
  EXPECT_NEAR((out.duty_abc - Vec3(1, 0, 0)).norm(), 0, 1e-15);
}

TEST(Svpwm, ZeroVoltageIsHalfDutyOnEveryLeg) {
  EXPECT_EQ(svpwm(Vec2::Zero(), kVdc).duty_abc, Vec3::Constant(0.5));
}

TEST(Svpwm, HighestAndLowestDutyLieSymmetricallyAboutHalf) {
  for (double angle : test::angles_over_a_turn(48)) {
    const Vec3 duty = svpwm(at_angle(9, angle), kVdc).duty_abc;
    EXPECT_NEAR(duty.maxCoeff() + duty.minCoeff(), 1, 1e-14);
  }
}

RC_GTEST_PROP(Svpwm, DutiesStayBetweenZeroAndOne, (int alpha, int beta)) {
  const InverterOutput out = svpwm({alpha * 1e-3, beta * 1e-3}, kVdc);
  RC_ASSERT(out.duty_abc.minCoeff() >= 0.0);
  RC_ASSERT(out.duty_abc.maxCoeff() <= 1.0);
  RC_ASSERT(out.u_alphabeta.norm() <= 2.0 / 3.0 * kVdc + 1e-9);
}

}  // namespace
}  // namespace twinrate
