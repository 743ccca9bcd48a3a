// Floquet multipliers of the closed loop against the simulated drive without noise.
#include "loop/closed_floquet.hpp"

#include <gtest/gtest.h>

#include "estimator/make_filter.hpp"
#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

Overrides drive_at(double omega_e, const Overrides& more = {}) {
  Overrides list{"start=flying", "sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0",
                 fmt::format("reference.omega_e_rad_s={}", omega_e)};
  list.insert(list.end(), more.begin(), more.end());
  return list;
}

std::optional<ClosedFloquet> floquet(double omega_e, const Overrides& more) {
  Config config = load("dilys2021", drive_at(omega_e, more));
  return ClosedFloquet::of(config, omega_e);
}

// Difference of the estimates of two drives, one of which felt a pulse of load at 0.2 s, with a gain every
// n-th tick from 0.22 s on: how it grows or decays over each period of n ticks, by its largest values in
// two windows.
double growth(double omega_e, const Overrides& more, int n) {
  Overrides quiet = drive_at(omega_e, more);
  quiet.push_back(fmt::format("rates.n={}", n));
  quiet.push_back("rates.n_from_s=0.22");
  quiet.push_back("load.slew_Nm_s=0");
  Overrides pulsed = quiet;
  pulsed.push_back("load.T_load_Nm=[[0,0],[0.2,1e-6],[0.21,0]]");
  ClosedLoop a(load("dilys2021", quiet)), b(load("dilys2021", pulsed));
  const double T_s = a.drive().T_s();
  double early = 0, late = 0;
  constexpr double kEarly_s = 0.25, kLate_s = 0.3, kWindow_s = 0.03;
  for (double t_s = 0; t_s < kLate_s + kWindow_s; t_s += T_s) {
    a.tick(), b.tick();
    const double off = std::abs(wrap_pi(a.angle_error() - b.angle_error()));
    if (t_s >= kEarly_s && t_s < kEarly_s + kWindow_s) early = std::max(early, off);
    if (t_s >= kLate_s) late = std::max(late, off);
  }
  return std::pow(late / early, n * T_s / (kLate_s - kEarly_s));
}

// Oracle: the parts that run in the drive. The start at speed settles before the pulse.
TEST(ClosedFloquet, ItsLargestMultiplierIsTheGrowthOfASmallDifference) {
  for (const char* controller : {"foc", "lqr"}) {
    const Overrides kind{fmt::format("controller.kind={}", controller)};
    const auto f = floquet(400, kind);
    ASSERT_TRUE(f);
    EXPECT_GT(f->spectral_radius(13), 1.05) << controller;
    EXPECT_NEAR(growth(400, kind, 13), f->spectral_radius(13), 0.03) << controller;
    EXPECT_LT(f->spectral_radius(12), 1) << controller;
    EXPECT_LT(growth(400, kind, 12), 1) << controller;
  }
}

// 400 rad/s: the paper's 12 (docs/find-fbmin.md); the filter alone has 12, too.
TEST(ClosedFloquet, PredictsTheLargestNOfBothControllers) {
  EXPECT_EQ(floquet(400, {})->n_max(20), 12);
  EXPECT_EQ(floquet(400, {"controller.kind=lqr"})->n_max(20), 12);
}

TEST(ClosedFloquet, TheControllerLimitsTheJointFilterWhereTheFilterAloneWouldHold) {
  const auto f = floquet(kTwoPi * 100, {"estimator.kind=ekf_joint"});
  ASSERT_TRUE(f);
  EXPECT_LT(f->n_max(20), f->n_max_of_filter(20));
}

// Kim's motor at 50 Hz. Held in simulation: n = 7 without load, n = 20 at 1.4 Nm.
TEST(ClosedFloquet, UnderLoadTheGainIsThatOfTheLoadedFilter) {
  const double omega_e = kTwoPi * 50;
  Config config = load("kim-ipmsm", {"estimator.kind=eemf"});
  const Steady idle{make_filter(config), GainPolicy::kPaper, omega_e / 2, omega_e, 1e-4};
  const auto unloaded = ClosedFloquet::of(config, idle, 0),
             loaded = ClosedFloquet::of(config, idle, 1.4);
  ASSERT_TRUE(unloaded && loaded);
  EXPECT_NEAR(unloaded->n_max(20), 7, 1);
  EXPECT_EQ(loaded->n_max(20), 20);
}

TEST(ClosedFloquet, ATurnedGainHasNoLimit) {
  EXPECT_EQ(floquet(400, {"gain.policy=rotate"})->n_max(60), 60);
}

// Its angle and speed, every fifth tick, are states of the loop: the low-pass decides how fast it settles.
TEST(ClosedFloquet, CoversTheAngleProcessingOfActiveFlux) {
  const Overrides kind{"estimator.kind=active_flux", "controller.foc.speed_bandwidth_Hz=4"};
  const auto f = floquet(400, kind);
  ASSERT_TRUE(f);
  EXPECT_LT(f->spectral_radius(10), 1);
  EXPECT_EQ(f->n_max(50), 50);
  // A speed loop far above the low-pass, with which the filter alone holds every n.
  const Overrides fast{kind[0], "controller.foc.speed_bandwidth_Hz=150"};
  const auto grows = floquet(400, fast);
  ASSERT_TRUE(grows);
  EXPECT_GT(grows->spectral_radius(5), 1.005);
  EXPECT_GT(growth(400, fast, 5), 1.005);
  EXPECT_LT(growth(400, kind, 5), 1);
  EXPECT_EQ(grows->n_max_of_filter(20), 20);
}

// On a machine without saliency, with its scaled noises, it is the same at every angle.
TEST(ClosedFloquet, CoversThePrintedFilterWithoutSaliency) {
  const Overrides slow{"estimator.kind=backemf_printed", "controller.foc.speed_bandwidth_Hz=8"};
  const auto f = floquet(400, slow);
  ASSERT_TRUE(f);
  const Overrides fast{slow[0], "controller.foc.speed_bandwidth_Hz=40"};
  const auto other = floquet(400, fast);
  ASSERT_TRUE(other);
  for (int n : {1, 5}) {
    EXPECT_NEAR(f->spectral_radius(n), growth(400, slow, n), 0.01) << n;
    EXPECT_NEAR(other->spectral_radius(n), growth(400, fast, n), 0.01) << n;
  }
  EXPECT_GT(f->spectral_radius(5) - other->spectral_radius(5), 0.015);
}

TEST(ClosedFloquet, DoesNotCoverAFilterThatDependsOnTheAngle) {
  Config salient = load("kim-ipmsm", {"estimator.kind=backemf_printed"});
  EXPECT_FALSE(ClosedFloquet::of(salient, 400));
  EXPECT_FALSE(floquet(
      400, {"estimator.kind=active_flux", "estimator.active_flux.Q_diag=[1e-4, 1e-4, 0.5, 0.1]"}));
}

}  // namespace
}  // namespace twinrate::test
