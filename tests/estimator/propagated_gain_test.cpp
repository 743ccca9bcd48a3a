// Policy propagated: many steps at once, and the gain at every speed.
#include "estimator/propagated_gain.hpp"

#include <gtest/gtest.h>

#include "estimator/gain_frame.hpp"
#include "estimator/gain_schedule.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::test::propagated_gain_test {
namespace {

std::shared_ptr<const Filter> sensorless(const Overrides& overrides = {}) {
  Config config = load("dilys2021", overrides);
  return make_filter(config);
}
Gain unsettled() {
  Gain gain;
  gain.n_x = 4;
  gain.n_y = 2;
  Eigen::Matrix4d A;
  A << 1, 0.2, 0.3, 0.1, 0.4, 1.5, 0.2, 0.6, 3, 1, 9, 0.5, 0.1, 0.7, 0.2, 0.8;
  gain.P.topLeftCorner<4, 4>() = A * A.transpose();
  return gain;
}

// Oracle: consecutive background steps of the filter.
TEST(BackgroundSteps, ByDoublingAreTheSameStepsOneAfterTheOther) {
  for (const char* form : {"joseph", "sequential"}) {
    const auto filter = sensorless({std::string("estimator.covariance=") + form});
    for (double omega_m : {0.0, 3.0, 100.0, -300.0})
      for (int ticks : {1, 2, 3, 8, 13, 100, 999}) {
        const Gain fast = filter->background_steps(unsettled(), omega_m, ticks);
        const Gain slow = filter->Filter::background_steps(unsettled(), omega_m, ticks);
        EXPECT_LT((fast.K - slow.K).norm(), 1e-8 * slow.K.norm()) << omega_m << " " << ticks;
        EXPECT_LT((fast.P - slow.P).norm(), 1e-8 * slow.P.norm()) << omega_m << " " << ticks;
        if (ticks > 8) continue;  // not settled: the covariance depends on the number of steps
        EXPECT_GT((filter->background_steps(unsettled(), omega_m, ticks + 1).P - slow.P).norm(),
                  1e-4 * slow.P.norm());
      }
  }
}

Estimate turning_at(const Filter& filter, double omega_m) {
  Estimate e = *filter.steady_state(omega_m);
  e.k = 0;
  e.theta_e = e.x_hat[3] = 0.7;
  return e;
}

// Oracle: the settled gain of GainSchedule for each direction, at the speeds of the table, without
// interpolation.
TEST(PropagatedGain, AfterManyTicksIsTheSettledGainInBothDirections) {
  const auto filter = sensorless();
  const auto schedule = GainSchedule::build(*filter, 600);
  for (double omega_m : {100.0, -100.0}) {
    const Gain sent = propagated_background(*filter, filter->initial_gain(), 0,
                                            turning_at(*filter, omega_m), 2000, 150);
    ASSERT_EQ(sent.n_speeds, 5);
    for (std::size_t i = 1; i < 5; ++i)
      for (double sign : {1.0, -1.0}) {
        Gain used = sent;
        const double speed = sign * sent.at_speed[i].omega_m;
        use_at_speed(1, speed, 1.3, used);
        const Gain settled = schedule->at(speed, 1.3);
        EXPECT_LT((used.K - settled.K).norm(), 2e-3 * settled.K.norm()) << speed;
        GainFrame(1, 0.2).turn_gain(used);  // the gain of another rotor position differs
        EXPECT_GT((used.K - settled.K).norm(), 0.1 * settled.K.norm()) << speed;
      }
  }
}

// Oracle: the filter's own background step. The gain of snapshot s is first used at s + n, so its
// covariance has gone n steps on from that of the snapshot.
TEST(PropagatedGain, IsThatOfTheTickAtWhichItIsFirstUsed) {
  const auto filter = sensorless();
  for (int n : {1, 5, 13}) {
    const Gain sent =
        propagated_background(*filter, unsettled(), 0, turning_at(*filter, 100), n, 150);
    Gain snapshot = sent;
    GainFrame(1, -sent.theta_e).turn_covariance(snapshot);
    for (std::size_t i : {0u, 2u, 4u}) {
      const GainAtSpeed& node = sent.at_speed[i];
      const auto after = [&](int steps) {
        return Eigen::Matrix<double, 4, 2>(
            filter->Filter::background_steps(snapshot, node.omega_m, steps)
                .K.topLeftCorner<4, 2>());
      };
      const Eigen::Matrix<double, 4, 2> K = node.K.topLeftCorner<4, 2>();
      EXPECT_LT((K - after(n)).norm(), 1e-8 * K.norm()) << n;
      for (int other : {n - 1, n + 1})
        if (other > 0) {
          EXPECT_GT((K - after(other)).norm(), 1e-5 * K.norm()) << n;
        }
    }
  }
}

TEST(PropagatedGain, TheSpeedsReachTheSpanOnBothSides) {
  const auto filter = sensorless();
  for (const auto& [omega_m, low, top] :
       {std::tuple{300.0, 150.0, 450.0}, std::tuple{20.0, 1.875, 170.0}}) {
    const Gain sent = propagated_background(*filter, filter->initial_gain(), 0,
                                            turning_at(*filter, omega_m), 20, 150);
    EXPECT_NEAR(sent.at_speed[0].omega_m, low, 1e-9);
    EXPECT_NEAR(sent.at_speed[4].omega_m, top, 1e-9);
  }
}

// The next run continues with the covariance of this one, for any change of the angle.
TEST(PropagatedGain, TwoRunsOfFiftyAreOneOfAHundredAtConstantSpeed) {
  const auto filter = sensorless();
  const double omega_m = 100;
  Estimate e = turning_at(*filter, omega_m);
  Gain twice = propagated_background(*filter, filter->initial_gain(), omega_m, e, 50, 150);
  Gain once = twice;
  for (int k : {50, 100}) {
    Estimate later = filter->ahead(e, k);
    later.k = k;
    twice = propagated_background(*filter, twice, omega_m, later, 50, 150);
    if (k == 100) once = propagated_background(*filter, once, omega_m, later, 50, 150);
  }
  EXPECT_LT((twice.P - once.P).norm(), 1e-9 * once.P.norm());
  EXPECT_LT((twice.K - once.K).norm(), 1e-9 * once.K.norm());
}

TEST(PropagatedGain, IsOfferedInTheStationaryFrameOnly) {
  EXPECT_TRUE(offers_propagated(*sensorless()));
  EXPECT_THROW(
      {
        Config config = load("niewiara2020", {"gain.policy=propagated"});
        make_fast_loop(config, false);
      },
      BadInput);
}

}  // namespace
}  // namespace twinrate::test::propagated_gain_test
