#include "model/frames.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <bit>
#include <cstdint>

#include "model/random.hpp"
#include "tests/support/angles.hpp"

namespace twinrate {
namespace {

// Balanced phases of amplitude I with the vector at angle phi: a leads, then b, then c.
Vec3 balanced_phases(double amplitude, double phi) {
  return {amplitude * std::cos(phi), amplitude * std::cos(phi - kTwoPi / 3),
          amplitude * std::cos(phi + kTwoPi / 3)};
}

TEST(Clarke, KeepsTheAmplitudeOfBalancedPhases) {
  for (int i = 0; i < 360; ++i) {
    const Vec2 x = clarke(balanced_phases(3.7, i * kPi / 180));
    EXPECT_NEAR(x.norm(), 3.7, 1e-14);
  }
}

TEST(Clarke, AlphaLiesOnPhaseAAndBetaNinetyDegreesAhead) {
  const Vec2 on_a = clarke(balanced_phases(1, 0));
  EXPECT_NEAR(on_a[0], 1, 1e-15);
  EXPECT_NEAR(on_a[1], 0, 1e-15);
  const Vec2 ahead = clarke(balanced_phases(1, kPi / 2));
  EXPECT_NEAR(ahead[0], 0, 1e-15);
  EXPECT_NEAR(ahead[1], 1, 1e-15);
}

TEST(Clarke, PhaseBStandsAtOneHundredTwentyDegrees) {
  const Vec2 x = clarke({-0.5, 1, -0.5});
  EXPECT_NEAR(std::atan2(x[1], x[0]), kTwoPi / 3, 1e-15);
}

TEST(Clarke, IgnoresWhatAllPhasesShare) {
  EXPECT_NEAR(clarke(Vec3::Constant(5.0)).norm(), 0, 1e-15);
}

TEST(InverseClarke, GivesPhasesThatSumToZero) {
  for (double phi : test::angles_over_a_turn(24)) {
    const Vec3 abc = inverse_clarke({2 * std::cos(phi), 2 * std::sin(phi)});
    EXPECT_NEAR(abc.sum(), 0, 1e-14);
    EXPECT_NEAR((abc - balanced_phases(2, phi)).norm(), 0, 1e-14);
  }
}

RC_GTEST_PROP(Clarke, RoundTripKeepsAnyVector, (int alpha, int beta)) {
  const Vec2 x(alpha * 1e-6, beta * 1e-6);
  RC_ASSERT((clarke(inverse_clarke(x)) - x).norm() <= 1e-14 * (1 + x.norm()));
}

TEST(Park, ARisingAngleTurnsTheFrameForward) {
  // A vector at 30 deg is 10 deg ahead of d for a rotor at 20 deg.
  const double deg = kPi / 180;
  const Vec2 dq = park({std::cos(30 * deg), std::sin(30 * deg)}, 20 * deg);
  EXPECT_NEAR(std::atan2(dq[1], dq[0]), 10 * deg, 1e-15);
}

TEST(Park, QLeadsDByNinetyDegrees) {
  for (double theta_e : test::angles_over_a_turn(16)) {
    const Vec2 q_axis = inverse_park({0, 1}, theta_e);
    EXPECT_NEAR(q_axis[0], std::cos(theta_e + kPi / 2), 1e-15);
    EXPECT_NEAR(q_axis[1], std::sin(theta_e + kPi / 2), 1e-15);
  }
}

TEST(Park, AtZeroAngleDIsAlpha) {
  const Vec2 dq = park({1.5, -0.5}, 0);
  EXPECT_EQ(dq[0], 1.5);
  EXPECT_EQ(dq[1], -0.5);
}

RC_GTEST_PROP(Park, RoundTripKeepsAnyVector, (int x0, int x1, int angle)) {
  const Vec2 x(x0 * 1e-6, x1 * 1e-6);
  const double theta_e = angle * 1e-6;
  RC_ASSERT((inverse_park(park(x, theta_e), theta_e) - x).norm() <= 1e-14 * (1 + x.norm()));
}

RC_GTEST_PROP(WrapTurn, LandsInTheHalfOpenTurnOnTheSamePointOfTheCircle, (int millionths)) {
  const double angle = millionths * 1e-5;
  const double wrapped = wrap_turn(angle);
  RC_ASSERT(wrapped >= 0.0);
  RC_ASSERT(wrapped < kTwoPi);
  const double turns = (angle - wrapped) / kTwoPi;
  RC_ASSERT(std::abs(turns - std::round(turns)) < 1e-10);
}

RC_GTEST_PROP(WrapPi, LandsInTheHalfOpenTurnOnTheSamePointOfTheCircle, (int millionths)) {
  const double angle = millionths * 1e-5;
  const double wrapped = wrap_pi(angle);
  RC_ASSERT(wrapped > -kPi);
  RC_ASSERT(wrapped <= kPi);
  const double turns = (angle - wrapped) / kTwoPi;
  RC_ASSERT(std::abs(turns - std::round(turns)) < 1e-10);
}

TEST(WrapTurn, HoldsAtItsEdges) {
  EXPECT_EQ(wrap_turn(0), 0);
  EXPECT_EQ(wrap_turn(kTwoPi), 0);
  EXPECT_EQ(wrap_turn(-kTwoPi), 0);
  // The sum of a tiny negative angle and a turn rounds to the turn itself, which is outside.
  EXPECT_LT(wrap_turn(-1e-20), kTwoPi);
  EXPECT_GE(wrap_turn(-1e-20), 0);
  EXPECT_LT(wrap_turn(std::nextafter(kTwoPi, 0)), kTwoPi);
}

// An angle inside the turn is returned without the division, with the bits that it would give.
TEST(WrapTurn, InsideTheTurnGivesTheBitsOfTheDivision) {
  const auto by_division = [](double angle) { return angle - kTwoPi * std::floor(angle / kTwoPi); };
  for (const double angle :
       {0.0, -0.0, 1e-300, kPi, std::nextafter(kTwoPi, 0), 4.9406564584124654e-324})
    EXPECT_EQ(std::bit_cast<std::uint64_t>(wrap_turn(angle)),
              std::bit_cast<std::uint64_t>(by_division(angle)))
        << angle;
  for (std::uint64_t k = 0; k < 10000; ++k) {
    const double angle = kTwoPi * uniform(1, 0, k);
    ASSERT_EQ(wrap_turn(angle), by_division(angle)) << angle;
  }
}

TEST(WrapPi, KeepsPlusPiAndTurnsMinusPiIntoIt) {
  EXPECT_EQ(wrap_pi(kPi), kPi);
  EXPECT_EQ(wrap_pi(-kPi), kPi);
  EXPECT_EQ(wrap_pi(0), 0);
  EXPECT_NEAR(wrap_pi(kPi + 0.1), -kPi + 0.1, 1e-15);
  EXPECT_NEAR(wrap_pi(-kPi - 0.1), kPi - 0.1, 1e-15);
}

}  // namespace
}  // namespace twinrate
