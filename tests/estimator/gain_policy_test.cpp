// The gain policies between snapshot and use of a gain.
#include <gtest/gtest.h>

#include <cmath>

#include "estimator/ekf_disturbance.hpp"
#include "estimator/gain_frame.hpp"
#include "estimator/gain_schedule.hpp"
#include "estimator/own_filter.hpp"
#include "estimator/registry.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/probe_filter.hpp"

namespace twinrate::test {
namespace {

std::shared_ptr<const Filter> sensorless(const Overrides& overrides = {}) {
  Config config = load("dilys2021", overrides);
  return make_filter(config);
}

Gain some_gain() {
  Gain gain;
  gain.k = 40;
  gain.n_x = 4;
  gain.n_y = 2;
  gain.K.topLeftCorner<4, 2>() << 0.5, 0.1, -0.2, 0.6, 3, -14, 0.2, -0.05;
  Eigen::Matrix4d A;
  A << 1, 0.2, 0.3, 0.1, 0.4, 1.5, 0.2, 0.6, 3, 1, 9, 0.5, 0.1, 0.7, 0.2, 0.8;
  gain.P.topLeftCorner<4, 4>() = A * A.transpose();
  return gain;
}

// Oracle: the filter itself. The machine is symmetric in the rotor position: a background step from
// a rotated start gives the rotated gain.
TEST(GainFrame, ABackgroundStepFromATurnedStartGivesTheTurnedGain) {
  const auto filter = sensorless();
  Estimate at = *filter->steady_state(100);
  at.k = 40;
  for (double angle : {0.3, 2.0, -1.1}) {
    Gain turned_start = some_gain(), expected = filter->background_step(some_gain(), at);
    Estimate turned_at = at;
    turned_at.x_hat[3] += angle;
    const GainFrame frame(1, angle);
    frame.turn_covariance(turned_start);
    frame.turn_gain(expected);
    frame.turn_covariance(expected);
    const Gain got = filter->background_step(turned_start, turned_at);
    EXPECT_LT((got.K - expected.K).norm(), 1e-12 * expected.K.norm()) << angle;
    EXPECT_LT((got.P - expected.P).norm(), 1e-12 * expected.P.norm()) << angle;
  }
}

TEST(GainFrame, TurnedTheOtherWayRoundItIsAnotherGain) {
  Gain forth = some_gain(), back = some_gain();
  GainFrame(1, 0.3).turn_gain(forth);
  GainFrame(1, -0.3).turn_gain(back);
  EXPECT_GT((forth.K - back.K).norm(), 1);
}

TEST(GainFrame, NoAngleChangesNoBit) {
  Gain gain = some_gain();
  GainFrame(1, 0).turn_gain(gain);
  GainFrame(1, 0).turn_covariance(gain);
  EXPECT_EQ(gain.K, some_gain().K);
  EXPECT_EQ(gain.P, some_gain().P);
}

TEST(GainFrame, AFilterInRotorAxesHasNothingToTurn) {
  Gain gain = some_gain();
  GainFrame(0, 1).turn_gain(gain);
  EXPECT_EQ(gain.K, some_gain().K);
}

TEST(EkfSensorless, AheadOfASnapshotTheRotorHasTurnedAndTheSpeedIsKept) {
  const auto filter = sensorless();
  Estimate e = *filter->steady_state(100);
  e.x_hat.head<2>() = Vec2(1, 0);
  const Estimate later = filter->ahead(e, 10);
  const double turned = 10 * 400 * 2e-4;
  EXPECT_NEAR(later.theta_e, turned, 1e-12);
  EXPECT_NEAR(later.x_hat[3], turned, 1e-12);
  EXPECT_EQ(later.x_hat[2], 400);
  EXPECT_NEAR(later.x_hat[0], std::cos(turned), 1e-12);
  EXPECT_NEAR(later.x_hat[1], std::sin(turned), 1e-12);
}

// Oracle: the filter with n = 1 in the stationary frame at constant speed, after settling.
TEST(GainSchedule, HoldsTheGainThatTheOrdinaryFilterSettlesTo) {
  const auto filter = sensorless();
  const auto schedule = GainSchedule::build(*filter, 800);
  for (double omega_m : {8.0, 100.0, 393.7, -8.0, -100.0, -393.7}) {
    Gain gain = filter->initial_gain();
    Estimate at = *filter->steady_state(omega_m);
    for (int k = 0; k < 4000; ++k) gain = filter->background_step(gain, filter->ahead(at, k));
    const Gain table = schedule->at(omega_m, filter->ahead(at, 3999).theta_e);
    EXPECT_LT((table.K - gain.K).norm(), 2e-3 * gain.K.norm()) << omega_m;
    EXPECT_EQ(table.n_x, 4);
    EXPECT_EQ(table.n_y, 2);
  }
}

TEST(GainSchedule, AWrongSignOfTheSpeedIsAnotherGain) {
  const auto schedule = GainSchedule::build(*sensorless(), 800);
  EXPECT_GT((schedule->rotor_gain(100) - schedule->rotor_gain(-100)).norm(), 0.1);
}

TEST(GainSchedule, IsFiniteAtStandstillBeyondItsEndAndForNonsense) {
  const auto schedule = GainSchedule::build(*sensorless(), 800);
  for (double omega_m : {0.0, -0.0, 1e-9, 800.0, 1e6, -1e6, double(NAN)})
    EXPECT_TRUE(schedule->at(omega_m, 1).K.allFinite()) << omega_m;
  EXPECT_EQ(schedule->rotor_gain(800), schedule->rotor_gain(1e6));
}

TEST(GainSchedule, TheDisturbanceFilterHasOneTooAndNeedsNoAngle) {
  Config config =
      load("dilys2021", {"estimator.kind=ekf_disturbance", "controller.angle_source=measured"});
  const auto filter = make_filter(config);
  const auto schedule = GainSchedule::build(*filter, 800);
  ASSERT_TRUE(schedule);
  EXPECT_EQ(schedule->at(50, 0).K, schedule->at(50, 2).K);
  Gain gain = filter->initial_gain();
  for (int k = 0; k < 40000; ++k) gain = filter->background_step(gain, *filter->steady_state(50));
  EXPECT_LT((schedule->at(50, 0).K - gain.K).norm(), 1e-2 * gain.K.norm());
}

// The same filter without its matrices: the table takes its steps one after the other.
class StepByStep : public OwnFilter {
 public:
  using OwnFilter::OwnFilter;
  std::optional<CovarianceModel> covariance_model(const Estimate&) const override { return {}; }
};

// ekf_harmonic would take half a minute: its matrices alone are compared.
TEST(GainSchedule, ByDoublingIsTheTableOfStepsOneAfterTheOther) {
  for (const std::string& kind : filter_kinds()) {
    if (kind == "ekf_harmonic") continue;
    Config config = load("dilys2021", {"estimator.kind=" + kind, "controller.angle_source=truth"});
    const auto by_doubling = GainSchedule::build(*make_filter(config), 838);
    const auto one_by_one = GainSchedule::build(StepByStep(config), 838);
    for (double omega_m : {-838.0, -20.0, -1.0, 0.0, 1.0, 8.0, 100.0, 393.7, 838.0}) {
      const auto K = one_by_one->rotor_gain(omega_m);
      EXPECT_LT((by_doubling->rotor_gain(omega_m) - K).norm(), 1e-8 * K.norm())
          << kind << " " << omega_m;
    }
  }
}

TEST(GainSchedule, TheModelOfAStepIsTheStep) {
  for (const std::string& kind : filter_kinds()) {
    Config config = load("kim-ipmsm", {"estimator.kind=" + kind, "controller.angle_source=truth"});
    const auto filter = make_filter(config);
    const Estimate at = *filter->steady_state(50);
    const auto model = filter->covariance_model(at);
    ASSERT_TRUE(model) << kind;
    const Gain first = filter->background_step(filter->initial_gain(), at);
    const Gain next = filter->background_step(first, at);
    const int n_x = next.n_x, n_y = next.n_y;
    const Eigen::MatrixXd F = model->F, H = model->H, Q = model->Q_diag.asDiagonal();
    const Eigen::MatrixXd R = model->R_diag.asDiagonal();
    const Eigen::MatrixXd P = F * first.P.topLeftCorner(n_x, n_x) * F.transpose() + Q;
    const Eigen::MatrixXd S = H * P * H.transpose() + R;
    const Eigen::MatrixXd K = P * H.transpose() * S.inverse();
    EXPECT_LT((next.K.topLeftCorner(n_x, n_y) - K).norm(), 1e-10 * K.norm()) << kind;
  }
}

TEST(GainSchedule, OfTwentyStatesTakesNoSeconds) {
  Config config = load("niewiara2020", {"estimator.kind=ekf_harmonic"});
  std::int64_t steps = 1000;  // one after the other: 5 million
  EXPECT_TRUE(GainSchedule::build(*make_filter(config), 209, steps));
}

TEST(GainSchedule, AFilterWithoutASteadyStateHasNone) {
  EXPECT_FALSE(GainSchedule::build(ProbeFilter(), 100));
}

Measurement sample(std::int64_t k) {
  Measurement m;
  m.k = k;
  m.signals = kPhaseCurrents | kVoltage;
  return m;
}

TEST(FallBack, TheTableReplacesAGainThatIsTooOldUntilTheNextGain) {
  const auto filter = sensorless();
  const int n = 4, max_age = 20;
  FastLoop fast(filter, GainPolicy::kPaper, n, {GainSchedule::build(*filter, 800), max_age});
  BackgroundLoop background(filter, GainPolicy::kPaper, n);
  const int silent_from = 40, silent_to = 80;  // the background is not heard
  for (std::int64_t k = 0; k < 120; ++k) {
    const Estimate e = fast.tick(sample(k));
    if (is_snapshot(k, n)) {
      const Gain& gain = background.step(e);
      if (k < silent_from || k >= silent_to) fast.take_gain(gain);
    }
    // The last gain heard before the silence is that of 36, the first after it that of 80.
    const bool late = k >= 44 && k<84, table = k> 36 + max_age && k < 84;
    EXPECT_EQ((e.status & kLateGain) != 0, late) << k;
    EXPECT_EQ((e.status & kScheduledGain) != 0, table) << k;
    if (table) {
      EXPECT_EQ(e.gain_seq, -1) << k;
    }
  }
}

// No gain is older than the estimator itself.
TEST(FallBack, AnEstimatorThatJoinsARunningDriveWaitsForItsFirstGain) {
  const auto filter = sensorless();
  FastLoop fast(filter, GainPolicy::kPaper, 5, {GainSchedule::build(*filter, 800), 20});
  for (std::int64_t k = 1003; k < 1040; ++k) {
    const Estimate e = fast.tick(sample(k));
    EXPECT_EQ((e.status & kScheduledGain) != 0, k > 1003 + 20) << k;
  }
}

// In rotor axes P is turned on by n - 1 ticks and the step itself makes the n-th: with any n it
// settles where the ordinary filter does.
TEST(RotorFrame, SettlesToTheGainOfTheOrdinaryFilter) {
  const auto filter = sensorless();
  const auto schedule = GainSchedule::build(*filter, 800);
  for (int n : {1, 3, 8}) {
    BackgroundLoop background(filter, GainPolicy::kRotorFrame, n);
    Estimate at;
    for (int i = 0; i < 4000; ++i) {
      at = filter->ahead(*filter->steady_state(100), static_cast<double>(i) * n);
      at.k = static_cast<std::int64_t>(i) * n;
      background.step(at);
    }
    const Gain settled = schedule->at(100, at.theta_e);
    EXPECT_LT((background.last().K - settled.K).norm(), 2e-3 * settled.K.norm()) << n;
  }
}

// A gain of policy extrapolate is used from n to 2n - 1 ticks after its snapshot: 3/2 (n - 1) + 1/2
// on the average, of which half a tick lies in the step.
TEST(Extrapolate, LinearisesInTheMiddleOfTheTicksThatUseTheGain) {
  const auto filter = sensorless();
  Estimate at = *filter->steady_state(100);
  at.k = 0;
  BackgroundLoop background(filter, GainPolicy::kExtrapolate, 8);
  EXPECT_NEAR(background.step(at).theta_e - at.theta_e, 1.5 * 7 * 400 * 2e-4, 1e-9);
}

TEST(FallBack, WithoutATableTheOldGainIsHeldForEver) {
  const auto filter = sensorless();
  FastLoop fast(filter, GainPolicy::kPaper, 4);
  BackgroundLoop background(filter, GainPolicy::kPaper, 4);
  fast.take_gain(background.step(fast.tick(sample(0))));
  Estimate e;
  for (std::int64_t k = 1; k < 500; ++k) e = fast.tick(sample(k));
  EXPECT_EQ(e.gain_seq, 0);
  EXPECT_EQ(e.status, kLateGain);
}

TEST(Scheduled, WaitsForNoGainAndReportsIt) {
  const auto filter = sensorless();
  FastLoop fast(filter, GainPolicy::kScheduled, 5, {GainSchedule::build(*filter, 800)});
  for (std::int64_t k = 0; k < 30; ++k) {
    EXPECT_TRUE(fast.gain_ready(k));
    const Estimate e = fast.tick(sample(k));
    EXPECT_EQ(e.status, kScheduledGain);
    EXPECT_EQ(e.gain_seq, -1);
  }
}

TEST(Scheduled, IsRefusedForAFilterWithoutATable) {
  EXPECT_DEATH(FastLoop(std::make_shared<ProbeFilter>(), GainPolicy::kScheduled, 1), "schedule");
}

}  // namespace
}  // namespace twinrate::test
