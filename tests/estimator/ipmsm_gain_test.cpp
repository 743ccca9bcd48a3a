// The frame in which the gains of the salient machine's filters rotate, used by the gain policies.
#include <gtest/gtest.h>

#include "estimator/gain_frame.hpp"
#include "estimator/gain_schedule.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::test {
namespace {

std::shared_ptr<const Filter> filter_of(const std::string& kind) {
  Config config = load("kim-ipmsm", {"estimator.kind=" + kind, "start=flying"});
  return make_filter(config);
}

constexpr double kOmegaM = 2000 * kPi / 30;
constexpr int kSettled = 4000, kLater = 23;  // 23 ticks at 2000 rpm are 55 deg

struct Settled {
  Gain now, later;
  double turned = 0;
};

// The background step at every tick at constant speed and current.
Settled settle(const Filter& filter, double omega_m) {
  Estimate at = *filter.steady_state(omega_m);
  at.x_hat.head<2>() = Vec2(-0.8, 1.4);
  Settled s;
  Gain gain = filter.initial_gain();
  for (int k = 0; k <= kSettled + kLater; ++k) {
    gain = filter.background_step(gain, filter.ahead(at, k));
    if (k == kSettled) s.now = gain;
  }
  s.later = gain;
  s.turned = kLater * 1e-4 * 2 * omega_m;
  return s;
}

double distance(const Gain& a, const Gain& b) {
  return (a.K - b.K).norm() / b.K.norm();
}

double turned_by(int pairs, const Settled& s) {
  Gain turned = s.now;
  GainFrame(pairs, s.turned).turn_gain(turned);
  return distance(turned, s.later);
}

class SalientFilter : public ::testing::TestWithParam<const char*> {};

// Oracle: the filter itself, every tick.
TEST_P(SalientFilter, ItsSettledGainTurnsAsItSays) {
  const auto filter = filter_of(GetParam());
  for (double omega_m : {kOmegaM, -kOmegaM, 0.2 * kOmegaM})
    EXPECT_LT(turned_by(filter->turning_pairs(), settle(*filter, omega_m)), 1e-6) << omega_m;
}

TEST_P(SalientFilter, AheadOfASnapshotTheRotorHasTurnedAtConstantSpeed) {
  const auto filter = filter_of(GetParam());
  const Estimate e = *filter->steady_state(kOmegaM), later = filter->ahead(e, 10);
  const double turned = 10 * 1e-4 * 2 * kOmegaM;
  EXPECT_NEAR(later.theta_e - e.theta_e, turned, 1e-12);
  EXPECT_NEAR(later.omega_m, kOmegaM, 1e-9);
  EXPECT_EQ(later.n_x, e.n_x);
  const bool emf_in_stator_axes = std::string(GetParam()) != "dq_ekf";
  if (!emf_in_stator_axes) return;
  // e = omega_e psi_f [-sin; cos]
  const double length = 2 * kOmegaM * 0.285;
  EXPECT_NEAR(later.x_hat[2], -length * std::sin(turned), 1e-3 * length);
  EXPECT_NEAR(later.x_hat[3], length * std::cos(turned), 1e-3 * length);
}

INSTANTIATE_TEST_SUITE_P(Kinds, SalientFilter,
                         ::testing::Values("backemf_printed", "active_flux", "eemf", "dq_ekf"),
                         [](const auto& i) { return std::string(i.param); });

TEST(SalientGains, InTheOtherFrameTheyWouldBeWrong) {
  // With the speed as a state the gain rotates; with two inductances fixed on the stator it does
  EXPECT_GT(turned_by(0, settle(*filter_of("eemf"), kOmegaM)), 0.05);
  EXPECT_GT(turned_by(2, settle(*filter_of("backemf_printed"), kOmegaM)), 0.05);
  EXPECT_GT(turned_by(1, settle(*filter_of("dq_ekf"), kOmegaM)), 0.05);
  // not. With equal axes both are the same.
  EXPECT_LT(turned_by(2, settle(*filter_of("active_flux"), kOmegaM)), 1e-6);
}

TEST(SalientGains, ThePrintedFiltersTableIsItsSettledGainInBothDirections) {
  const auto filter = filter_of("backemf_printed");
  const auto schedule = GainSchedule::build(*filter, 1.5 * kOmegaM);
  ASSERT_TRUE(schedule);
  for (double omega_m : {kOmegaM, -kOmegaM})
    for (double theta_e : {0.0, 2.0})
      EXPECT_LT(distance(schedule->at(omega_m, theta_e), settle(*filter, omega_m).later), 1e-3)
          << omega_m;
  EXPECT_GT(distance(schedule->at(kOmegaM, 0), schedule->at(-kOmegaM, 0)), 0.05);
}

}  // namespace
}  // namespace twinrate::test
