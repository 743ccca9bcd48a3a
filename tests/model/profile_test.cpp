#include "model/profile.hpp"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>

namespace twinrate {
namespace {

TEST(Profile, AConstantHoldsForAllTime) {
  const Profile profile(7.5);
  EXPECT_TRUE(profile.is_constant());
  for (double t : {-1.0, 0.0, 1e6}) EXPECT_EQ(profile.at(t), 7.5);
}

TEST(Profile, EachStepHoldsFromItsTimeToTheNext) {
  const Profile profile(std::vector<ProfileStep>{{1.0, 10}, {2.0, 20}, {3.0, -5}});
  EXPECT_FALSE(profile.is_constant());
  EXPECT_EQ(profile.at(0), 10);  // before the first step: its value
  EXPECT_EQ(profile.at(1.0), 10);
  EXPECT_EQ(profile.at(std::nextafter(2.0, 0)), 10);
  EXPECT_EQ(profile.at(2.0), 20);  // a step holds from its very time on
  EXPECT_EQ(profile.at(2.999), 20);
  EXPECT_EQ(profile.at(3.0), -5);
  EXPECT_EQ(profile.at(1e9), -5);
}

TEST(Slew, MovesAtTheRateAndStopsAtTheTarget) {
  EXPECT_DOUBLE_EQ(slew(0, 10, 4, 0.5), 2);
  EXPECT_DOUBLE_EQ(slew(0, -10, 4, 0.5), -2);
  EXPECT_EQ(slew(9, 10, 4, 0.5), 10);
  EXPECT_EQ(slew(-9, -10, 4, 0.5), -10);
  EXPECT_EQ(slew(3, 3, 4, 0.5), 3);
}

TEST(Slew, ARateOfZeroIsNoLimit) {
  EXPECT_EQ(slew(0, 1e9, 0, 1e-4), 1e9);
}

RC_GTEST_PROP(Slew, NeverOvershootsAndNeverOutrunsItsRate,
              (int from_m, int to_m, unsigned short r)) {
  const double from = from_m * 1e-3, to = to_m * 1e-3, rate = 1 + r, dt = 1e-2;
  const double next = slew(from, to, rate, dt);
  RC_ASSERT(std::abs(next - from) <= rate * dt * (1 + 1e-9) + 1e-9);
  RC_ASSERT(std::abs(to - next) <= std::abs(to - from));
  RC_ASSERT((next - from) * (to - from) >= 0.0);
}

}  // namespace
}  // namespace twinrate
