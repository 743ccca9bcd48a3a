#include "estimator/two_rate.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "estimator/ekf_disturbance.hpp"
#include "estimator/ekf_sensorless.hpp"
#include "tests/support/field_setter.hpp"
#include "tests/support/probe_filter.hpp"

namespace twinrate::two_rate_test {
namespace {

using test::ProbeFilter;

Measurement sample(std::int64_t k) {
  return {.k = k, .t_ns = 200000 * k};
}

TEST(KnownLag, OfTheVoltageMixesItWithTheSampleBefore) {
  const auto lag = make_effect("signal_lag");
  test::FieldSetter set({{"signal", 0}, {"lag_s", 6e-5}});
  lag->fields(set);
  const KnownEffects known({lag}, {.n_p = 4}, 3, 2e-4);
  Measurement m = sample(8), before = sample(7);
  m.signals = before.signals = kPhaseCurrents | kVoltage;
  m.u_alphabeta = {3, -1};
  before.u_alphabeta = {1, 2};
  EXPECT_NEAR((known.seen(m, {}, before).u_alphabeta - Vec2(2.4, -0.1)).norm(), 0, 1e-12);
  before.k = 6;  // a sample is missing between them
  EXPECT_EQ(known.seen(m, {}, before).u_alphabeta, m.u_alphabeta);
}

TEST(KnownLag, OfTheCurrentIsCarriedToTheCurrentOfNowUnderTheVoltageOfTheSample) {
  const MachineParameters machine{
      .R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .B = 1e-5, .n_p = 4};
  constexpr double kTs = 2e-4, kLag = 1e-4, kOmegaE = 400;
  const auto lag = make_effect("signal_lag");
  test::FieldSetter set({{"signal", 1}, {"lag_s", kLag}});
  lag->fields(set);
  const KnownEffects known({lag}, machine, 3, kTs);
  Estimate last;
  last.k = 7;
  last.omega_m = kOmegaE / 4;
  last.theta_e = 0.6;
  Measurement m = sample(8);
  m.signals = kPhaseCurrents | kVoltage;
  m.u_alphabeta = {3, -2};
  // Oracle: midpoint steps of the stationary currents over the lag.
  const double theta_e_now = 0.6 + kTs * kOmegaE;
  const Vec2 then(0.8, -0.5);
  constexpr int kSteps = 1000;
  const auto rate = [&](const Vec2& i, double t) {
    const double theta_e = theta_e_now + kOmegaE * (t - kLag);
    const Vec2 emf = kOmegaE * 0.007 * Vec2(-std::sin(theta_e), std::cos(theta_e));
    return Vec2((m.u_alphabeta - 1.2 * i - emf) / 5e-4);
  };
  Vec2 now = then;
  for (int j = 0; j < kSteps; ++j) {
    const double h = kLag / kSteps, t = j * h;
    now += h * rate(now + 0.5 * h * rate(now, t), t + 0.5 * h);
  }
  m.i_abc = inverse_clarke(then);
  EXPECT_GT((now - then).norm(), 0.3);
  EXPECT_LT((clarke(known.seen(m, last, {}).i_abc) - now).norm(), 0.02 * (now - then).norm());
}

// Voltage only: the filter predicts with it and reports it in the status.
TEST(LostRow, IsPredictedOverUnderItsOwnVoltage) {
  const MachineParameters machine{
      .R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .B = 1e-5, .n_p = 4};
  const auto filter = std::make_shared<EkfSensorless>(
      machine, EkfSensorlessParameters{}, Prediction::kRk4, CovarianceForm::kJoseph, 2e-4, 400.0);
  FastLoop fast(filter, GainPolicy::kPaper, 1);
  Measurement m = sample(0);
  m.signals = kPhaseCurrents | kVoltage;
  fast.tick(m);
  Gain gain = filter->initial_gain();
  gain.K.topLeftCorner<4, 2>().setConstant(0.5);
  gain.k = 0;
  fast.take_gain(gain);
  FastState expected = filter->start(m);
  Measurement lost = sample(1);
  lost.signals = kVoltage;
  lost.u_alphabeta = {3, -1};
  lost.i_abc = {100, -50, -50};  // must not be used
  filter->predict_over_gap(expected, lost);
  const Estimate e = fast.tick(lost);
  EXPECT_EQ(e.x_hat, expected.x_hat);
  EXPECT_TRUE(e.status & kGapBridged);
  EXPECT_TRUE(e.innov.isZero(0));
  // The next one is corrected again.
  Measurement there = sample(2);
  there.signals = kPhaseCurrents | kVoltage;
  const Estimate after = fast.tick(there);
  EXPECT_EQ(after.status & kGapBridged, 0);
  EXPECT_FALSE(after.innov.isZero(1e-9));
}

class Timing : public testing::TestWithParam<int> {};

TEST_P(Timing, PaperUsesTheGainOfTheSnapshotOneFullPeriodAgo) {
  const int n = GetParam();
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kPaper, n);
  BackgroundLoop background(probe, GainPolicy::kPaper, n);
  for (std::int64_t k = 0; k < 10 * n; ++k) {
    const Estimate e = fast.tick(sample(k));
    EXPECT_EQ(e.status & kLateGain, 0);
    EXPECT_EQ((e.status & kBeforeFirstGain) != 0, k < n);
    if (k % n == 0) fast.take_gain(background.step(e));
  }
  // The rule of docs/theory/two-rate-ekf.md, by counting: K from tick s in ticks s+n .. s+2n-1.
  for (const ProbeFilter::Use& use : probe->used) {
    std::int64_t expected = -1;
    for (std::int64_t s = 0; s < 10 * n; s += n)
      if (use.tick >= s + n && use.tick <= s + 2 * n - 1) expected = s;
    EXPECT_EQ(use.snapshot, expected) << "tick " << use.tick;
  }
}

TEST_P(Timing, ImmediateUsesItFromTheNextTickForOnePeriod) {
  const int n = GetParam();
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kImmediate, n);
  BackgroundLoop background(probe, GainPolicy::kImmediate, n);
  for (std::int64_t k = 0; k < 10 * n; ++k) {
    const Estimate e = fast.tick(sample(k));
    EXPECT_EQ(e.status & kLateGain, 0);
    if (k % n == 0) fast.take_gain(background.step(e));
  }
  for (const ProbeFilter::Use& use : probe->used) {
    std::int64_t expected = -1;
    for (std::int64_t s = 0; s < 10 * n; s += n)
      if (use.tick >= s + 1 && use.tick <= s + n) expected = s;
    EXPECT_EQ(use.snapshot, expected) << "tick " << use.tick;
  }
}

TEST_P(Timing, EveryGainHasTheTickOfItsFirstUse) {
  const int n = GetParam();
  const auto probe = std::make_shared<ProbeFilter>();
  BackgroundLoop paper(probe, GainPolicy::kPaper, n), immediate(probe, GainPolicy::kImmediate, n);
  EXPECT_EQ(paper.step({.k = 3 * n}).first_use, 4 * n);
  EXPECT_EQ(immediate.step({.k = 3 * n}).first_use, 3 * n + 1);
}

INSTANTIATE_TEST_SUITE_P(N, Timing, testing::Range(1, 14));

TEST(FastLoop, HoldsTheOldGainAndReportsALateOne) {
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kPaper, 4);
  BackgroundLoop background(probe, GainPolicy::kPaper, 4);
  Gain withheld;
  for (std::int64_t k = 0; k < 24; ++k) {
    if (k == 14) fast.take_gain(withheld);  // due at 12, there at 14
    EXPECT_EQ(fast.gain_ready(k), !(k == 12 || k == 13)) << k;
    const Estimate e = fast.tick(sample(k));
    const bool late = k == 12 || k == 13;
    EXPECT_EQ((e.status & kLateGain) != 0, late) << k;
    const std::int64_t planned = k < 4 ? -1 : k / 4 * 4 - 4;
    EXPECT_EQ(e.gain_seq, late ? 4 : planned) << k;
    if (k % 4 != 0) continue;
    const Gain gain = background.step(e);
    if (k == 8)
      withheld = gain;
    else
      fast.take_gain(gain);
  }
}

TEST(FastLoop, ARepeatedGainChangesNothing) {
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kPaper, 2);
  for (std::int64_t k = 0; k < 20; ++k) {
    const Estimate e = fast.tick(sample(k));
    if (k % 2 != 0) continue;
    for (int copy = 0; copy < 5; ++copy) fast.take_gain({.k = e.k});
    EXPECT_EQ(e.gain_seq, k >= 2 ? k - 2 : -1);
  }
}

TEST(FastLoop, PredictsOnceForEachMissingSampleAndReportsTheGap) {
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kPaper, 1);
  fast.tick(sample(0));
  EXPECT_EQ(fast.tick(sample(1)).status & kGapBridged, 0);
  const Estimate e = fast.tick(sample(5));
  EXPECT_NE(e.status & kGapBridged, 0);
  EXPECT_EQ(probe->bridged_from, (std::vector<std::int64_t>{1, 1, 1}));  // ticks 2, 3, 4
  EXPECT_EQ(fast.tick(sample(6)).status & kGapBridged, 0);
  EXPECT_EQ(probe->starts, 1);
}

TEST(FastLoop, BridgesFiftyAndStartsAgainAfterFiftyOne) {
  for (std::int64_t missing : {50, 51}) {
    const auto probe = std::make_shared<ProbeFilter>();
    FastLoop fast(probe, GainPolicy::kPaper, 1);
    fast.tick(sample(0));
    fast.take_gain({.k = 0});
    const Estimate e = fast.tick(sample(missing + 1));
    EXPECT_NE(e.status & kGapBridged, 0);
    EXPECT_EQ(probe->starts, missing == 50 ? 1 : 2);
    EXPECT_EQ(probe->bridged_from.size(), missing == 50 ? 50u : 0u);
    EXPECT_EQ((e.status & kBeforeFirstGain) != 0, missing == 51);
  }
}

TEST(FastLoop, ASessionMayStartAtAnyTick) {
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kPaper, 5);
  BackgroundLoop background(probe, GainPolicy::kPaper, 5);
  for (std::int64_t k = 1003; k < 1030; ++k) {
    EXPECT_TRUE(fast.gain_ready(k));
    const Estimate e = fast.tick(sample(k));
    EXPECT_EQ(e.status & kLateGain, 0) << k;  // none was planned before 1010
    EXPECT_EQ(e.gain_seq, k < 1010 ? -1 : k / 5 * 5 - 5);
    if (k % 5 == 0) fast.take_gain(background.step(e));
  }
}

TEST(FastLoop, ResetForgetsGainsAndState) {
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kPaper, 1);
  fast.tick(sample(0));
  fast.take_gain({.k = 0});
  fast.reset();
  EXPECT_EQ(fast.last_k(), -1);
  const Estimate e = fast.tick(sample(0));
  EXPECT_EQ(e.gain_seq, -1);
  EXPECT_EQ(probe->starts, 2);
}

TEST(FastLoop, AlignmentForcesTheAngleAndTheBackgroundStartsFromP0) {
  const auto probe = std::make_shared<ProbeFilter>();
  FastLoop fast(probe, GainPolicy::kPaper, 1);
  BackgroundLoop background(probe, GainPolicy::kPaper, 1);
  for (int k = 0; k < 5; ++k) background.step(fast.tick(sample(k)));
  EXPECT_EQ(background.last().P(0, 0), 5);
  Measurement forced = sample(5);
  forced.mode = Mode::kAlign;
  forced.theta_forced = 1.25;
  const Estimate e = fast.tick(forced);
  EXPECT_EQ(e.theta_e, 1.25);
  EXPECT_NE(e.status & kAngleForced, 0);
  EXPECT_EQ(background.step(e).P(0, 0), 1);
  EXPECT_EQ(background.step(fast.tick(sample(6))).P(0, 0), 2);
  forced.k = 7;
  forced.mode = Mode::kIfRamp;  // the ramp rotates the rotor, but its angle is unknown
  EXPECT_EQ(fast.tick(forced).status & kAngleForced, 0);
}

// Every filter reports and ignores a sample that is not finite.
class EveryFilter : public testing::TestWithParam<bool> {
 protected:
  static std::shared_ptr<const Filter> make() {
    const MachineParameters m{
        .R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .n_p = 4};
    if (GetParam())
      return std::make_shared<EkfSensorless>(m, EkfSensorlessParameters{}, Prediction::kEuler,
                                             CovarianceForm::kJoseph, 2e-4);
    return std::make_shared<EkfDisturbance>(m, EkfDisturbanceParameters{}, Prediction::kEuler,
                                            CovarianceForm::kJoseph, 2e-4);
  }
  static Measurement good(std::int64_t k) {
    Measurement m = sample(k);
    m.signals = kPhaseCurrents | kVoltage | kPosition | kSpeed;
    m.i_abc = {1, -0.5, -0.5};
    return m;
  }
};

TEST_P(EveryFilter, ANonFiniteSampleLeavesTheStateFiniteAndIsReported) {
  const auto filter = make();
  FastLoop fast(filter, GainPolicy::kPaper, 1);
  BackgroundLoop background(filter, GainPolicy::kPaper, 1);
  for (std::int64_t k = 0; k < 30; ++k) {
    Measurement m = good(k);
    if (k == 10) m.i_abc[1] = std::numeric_limits<double>::quiet_NaN();
    if (k == 20) m.u_alphabeta[0] = std::numeric_limits<double>::infinity();
    const Estimate e = fast.tick(m);
    ASSERT_TRUE(e.x_hat.allFinite()) << k;
    ASSERT_TRUE(e.innov.allFinite()) << k;
    EXPECT_EQ((e.status & kNotFinite) != 0, k == 10 || k == 20) << k;
    const Gain& gain = background.step(e);
    ASSERT_TRUE(gain.K.allFinite() && gain.P.allFinite());
    fast.take_gain(gain);
  }
}

TEST_P(EveryFilter, ANonFiniteFirstSampleDoesNotPoisonTheSession) {
  FastLoop fast(make(), GainPolicy::kPaper, 1);
  Measurement m = good(0);
  m.i_abc[0] = std::numeric_limits<double>::quiet_NaN();
  const Estimate first = fast.tick(m);
  EXPECT_TRUE(first.x_hat.allFinite());
  EXPECT_NE(first.status & kNotFinite, 0);
  const Estimate second = fast.tick(good(1));
  EXPECT_TRUE(second.x_hat.allFinite());
  EXPECT_EQ(second.status & kNotFinite, 0);
}

TEST_P(EveryFilter, ALeftOutCorrectionStillPredicts) {
  // 100 V on alpha with a broken current sample: the current rises by the voltage alone.
  FastLoop fast(make(), GainPolicy::kPaper, 1);
  Measurement m = good(0);
  m.i_abc = Vec3::Zero();
  fast.tick(m);
  m = good(1);
  m.i_abc[1] = std::numeric_limits<double>::quiet_NaN();
  m.u_alphabeta = {100, 0};
  const Estimate e = fast.tick(m);
  EXPECT_NEAR(e.x_hat[0], 100 * 2e-4 / 5e-4, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(Kinds, EveryFilter, testing::Bool(), [](const auto& i) {
  return i.param ? "ekf_sensorless" : "ekf_disturbance";
});

}  // namespace
}  // namespace twinrate::two_rate_test
