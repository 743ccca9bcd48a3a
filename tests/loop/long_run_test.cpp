// Numerics that do not tire: covariances over many updates, and a session that begins thirty days
// late.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/reason.hpp"
#include "estimator/make_filter.hpp"
#include "estimator/registry.hpp"
#include "loop/closed_loop.hpp"
#include "model/frames.hpp"
#include "model/linear_algebra.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::long_run_test {
namespace {

// A drive that the filter is made for.
std::string drive_of(const std::string& kind) {
  const bool salient = kind == "active_flux" || kind == "eemf" || kind == "dq_ekf";
  if (salient || kind == "backemf_printed") return "kim-ipmsm";
  return kind == "ekf_sensorless" || kind == "ekf_joint" ? "dilys2021" : "niewiara2020";
}

// The snapshots of the last `count` ticks that sent a gain, at constant speed or at standstill.
std::vector<Estimate> snapshots(Config& config, double duration_s, std::size_t count) {
  ClosedLoop loop(config);
  std::vector<Estimate> all;
  while (static_cast<double>(loop.k()) * config.drive().T_s() < duration_s) {
    const TickRecord& tick = loop.step();
    if (tick.has_gain) all.push_back(tick.estimate);
  }
  if (all.size() > count) all.erase(all.begin(), all.end() - static_cast<std::ptrdiff_t>(count));
  return all;
}

struct Worst {
  double asymmetry = 0, smallest = 1;  // of the correlation matrix; its least eigenvalue
};

void note(const Gain& gain, Worst& worst) {
  const Eigen::MatrixXd P = gain.P.topLeftCorner(gain.n_x, gain.n_x);
  ASSERT_TRUE(P.allFinite() && gain.K.allFinite());
  ASSERT_GT(P.diagonal().minCoeff(), 0);
  const Eigen::VectorXd scale = P.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd C = scale.asDiagonal() * P * scale.asDiagonal();
  worst.asymmetry = std::max(worst.asymmetry, (C - C.transpose()).cwiseAbs().maxCoeff());
  worst.smallest =
      std::min(worst.smallest, linear::symmetric_eigen(0.5 * (C + C.transpose())).values[0]);
}

// The snapshots over and over.
Worst updates(Config& config, const std::vector<Estimate>& at, std::int64_t count) {
  BackgroundLoop background = make_background_loop(config);
  Worst worst;
  const int n = config.drive().rates.n;
  for (std::int64_t i = 0; i < count; ++i) {
    Estimate e = at[static_cast<std::size_t>(i) % at.size()];
    e.k = i * n;
    const Gain& gain = background.step(e);
    if (i % 1000 == 999) note(gain, worst);
  }
  return worst;
}

class LongCovariance : public testing::TestWithParam<std::tuple<std::string, const char*>> {};

TEST_P(LongCovariance, StaysSymmetricAndPositiveAtSpeedAndAtStandstill) {
  const auto& [kind, policy] = GetParam();
  for (const char* reference : {"", "reference.omega_e_rad_s=0"}) {
    test::Overrides overrides = {"estimator.kind=" + kind,
                                 std::string("gain.policy=") + policy,
                                 "load.T_load_Nm=0",
                                 "rates.n=2",
                                 "rates.n_from=start",
                                 "controller.kind=foc",
                                 "controller.angle_source=truth"};
    if (*reference) overrides.push_back("reference.speed_rpm=0");
    Config config = test::load(drive_of(kind), overrides);
    const std::vector<Estimate> at = snapshots(config, 0.3, 100);
    ASSERT_FALSE(at.empty());
    const Worst worst = updates(config, at, 20000);
    EXPECT_LT(worst.asymmetry, 1e-6) << reference;
    EXPECT_GT(worst.smallest, 1e-12) << reference;
  }
}

std::string name_of(const testing::TestParamInfo<std::tuple<std::string, const char*>>& made) {
  return std::get<0>(made.param) + "_" + std::get<1>(made.param);
}

INSTANTIATE_TEST_SUITE_P(Filters, LongCovariance,
                         testing::Combine(testing::ValuesIn(filter_kinds()),
                                          testing::Values("paper", "extrapolate", "rotor_frame")),
                         name_of);
// These three differ in the use of K alone: what is shown of one covariance is shown of all. So does
// rotor_frame where no state turns.
TEST(GainPolicies, PaperImmediateAndRotateHaveTheSameCovarianceBitForBit) {
  for (const std::string& kind : filter_kinds()) {
    Config config =
        test::load(drive_of(kind), {"estimator.kind=" + kind, "load.T_load_Nm=0", "rates.n=2",
                                    "controller.kind=foc", "controller.angle_source=truth"});
    const std::vector<Estimate> at = snapshots(config, 0.1, 100);
    const std::shared_ptr<const Filter> filter = make_filter(config);
    std::vector<GainPolicy> policies = {GainPolicy::kPaper, GainPolicy::kImmediate,
                                        GainPolicy::kRotate};
    if (filter->turning_pairs() == 0) policies.push_back(GainPolicy::kRotorFrame);
    std::vector<BackgroundLoop> loops;
    loops.reserve(policies.size());
    for (const GainPolicy policy : policies) loops.emplace_back(filter, policy, BackgroundRate(2));
    for (BackgroundLoop& loop : loops) loop.limit(CovarianceCeiling(*filter, 0));
    for (const Estimate& e : at) {
      const Gain& paper = loops[0].step(e);
      for (std::size_t i = 1; i < loops.size(); ++i) {
        const Gain& other = loops[i].step(e);
        ASSERT_EQ(paper.P, other.P) << kind << ", tick " << e.k;
        ASSERT_EQ(paper.K, other.K) << kind << ", tick " << e.k;
      }
    }
    EXPECT_GT((loops[0].last().P - filter->initial_gain().P).norm(), 0) << kind;
  }
}

// Filters in the stationary frame with a steady state.
INSTANTIATE_TEST_SUITE_P(Propagated, LongCovariance,
                         testing::Combine(testing::Values("ekf_sensorless", "eemf", "ekf_joint"),
                                          testing::Values("propagated")),
                         name_of);

// A rotor that stands shows an EMF of zero: nothing bounds the variance of the angle but the ceiling.
TEST(LongStandstill, LeavesEveryVarianceBelowItsCeiling) {
  for (const std::string& kind : filter_kinds()) {
    Config config = test::load(
        drive_of(kind), {"estimator.kind=" + kind, "controller.kind=foc", "load.T_load_Nm=0"});
    BackgroundLoop background = make_background_loop(config);
    ASSERT_FALSE(background.ceiling().none()) << kind;
    const auto P_max = background.ceiling().P_max();
    Estimate still;
    still.n_x = background.last().n_x;
    double share = 0;
    for (int i = 0; i < 50000; ++i) {
      still.k = i * config.drive().rates.n;
      const Gain& gain = background.step(still);
      const auto variances = gain.P.diagonal().head(gain.n_x);
      share = std::max(share, variances.cwiseQuotient(P_max).maxCoeff());
      if (i % 1000 == 999) {
        Worst worst;
        note(gain, worst);
        EXPECT_LT(worst.asymmetry, 1e-6) << kind;
        EXPECT_GT(worst.smallest, 1e-12) << kind;
      }
    }
    EXPECT_LE(share, 1 + 1e-12) << kind;
    EXPECT_GT(share, kind == "ekf_sensorless" ? 0.99 : 0) << "reached by the angle that has no EMF";
  }
}

// Without a ceiling the gain of the first EMF throws the angle away, and the drive loses synchronism.
TEST(LongStandstill, OfManyUpdatesDoesNotSpoilTheStart) {
  Config config = test::load("dilys2021", {"sensors.i_noise_rms_A=0", "run.duration_s=101",
                                           "reference.omega_e_rad_s=[[0,0],[100,0],[100.05,400]]"});
  ClosedLoop loop(config);
  const int n_p = config.drive().machine.n_p;
  double worst = 0;
  for (int k = 0; k < 101 * 5000; ++k) {
    const TickRecord& tick = loop.step();
    worst = std::max(worst, std::abs(wrap_pi(tick.estimate.theta_e - n_p * tick.truth.theta_m)));
  }
  EXPECT_LT(test::degrees(worst), 15);
}

// The whole loop over the end of 32 bits of ticks, and after 30 days: it goes on as at tick 0.
TEST(LateSession, ADriveOverTheEndOf32BitsOfTicksGoesOn) {
  const auto run = [](const char* drive, std::int64_t first, double theta_m) {
    Config config = test::load(drive, {"rates.n=5", "run.duration_s=1"});
    ClosedLoop loop(config);
    loop.begin_at(first, theta_m);
    double worst = 0;
    std::int64_t gains = 0;
    for (int i = 0; i < 2500; ++i) {
      const TickRecord& tick = loop.step();
      EXPECT_EQ(tick.measurement.k, first + i);
      EXPECT_EQ(tick.command.k, first + i);
      for (const PlantEvent& event : tick.plant_events)
        EXPECT_FALSE(is_trip(event.reason)) << drive << i << event.text;
      if (i < 1500) continue;
      gains += tick.has_gain;
      worst = std::max(worst, std::abs(wrap_pi(tick.estimate.theta_e -
                                               config.drive().machine.n_p * tick.truth.theta_m)));
      EXPECT_EQ(tick.estimate.status & (kLateGain | kGapBridged | kNotFinite), 0) << drive << i;
    }
    EXPECT_EQ(gains, 200) << drive << first;
    return worst;
  };
  for (const char* drive : {"dilys2021", "niewiara2020"}) {
    const double usual = run(drive, 0, 0);
    for (const std::int64_t end : {std::int64_t{1} << 32, 12'960'000'000}) {
      const std::int64_t first = (end / 5 - 400) * 5;  // the end is among the figures
      const double theta_m = kTwoPi * 1e9;             // 2400 rad/s for 30 days
      EXPECT_NEAR(run(drive, first, theta_m), usual, 0.2 * usual + 1e-3) << drive << end;
    }
  }
}

// 30 days at 5 kHz are 1.3e10 ticks, and 2.6e8 rad at 100 rad/s.
TEST(LateSession, AnEstimatorThirtyDaysOnGivesTheSameEstimates) {
  for (const char* drive : {"dilys2021", "niewiara2020"}) {
    Config config = test::load(drive, {"rates.n=5"});
    const std::int64_t late = 5 * std::int64_t{2'600'000'000};
    ClosedLoop loop(config);
    EstimatorLoop early(config), later(config);
    for (int k = 0; k < 3000; ++k) {
      const Measurement m = loop.step().measurement;
      Measurement shifted = m;
      shifted.k += late;
      shifted.t_ns = config.drive().t_ns(shifted.k);
      const Estimate a = early.tick(m), b = later.tick(shifted);
      ASSERT_EQ(b.k, a.k + late);
      ASSERT_EQ(b.status, a.status) << drive << k;
      ASSERT_EQ(b.theta_e, a.theta_e) << drive << k;
      ASSERT_EQ(b.omega_m, a.omega_m) << drive << k;
      ASSERT_EQ(later.has_gain(), early.has_gain());
      ASSERT_EQ(shifted.t_ns - config.drive().t_ns(late), m.t_ns) << "exact to the nanosecond";
    }
  }
}

}  // namespace
}  // namespace twinrate::long_run_test
