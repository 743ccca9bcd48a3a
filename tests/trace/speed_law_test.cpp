// A load torque by a law of the speed that the catalogue does not have is not named after effects
// that approximate it.
#include "trace/speed_law.hpp"

#include <gtest/gtest.h>

#include "tests/trace/fitted_drive.hpp"
#include "tests/trace/traced_drive.hpp"
#include "trace/steps_at_reversals.hpp"

namespace twinrate {
namespace {

constexpr double kFast = 70;  // rad/s

SyntheticDrive with_power(double exponent, double T_fast) {
  SyntheticDrive d;
  d.extra_load = [=](double, double, double omega) {
    return std::copysign(T_fast * std::pow(std::abs(omega) / kFast, exponent), omega);
  };
  return d;
}

std::optional<SpeedLaw> law_of(const SyntheticDrive& d, const Members& members) {
  const FittedDrive drive(simulate_synthetic(d), members);
  const Fitter fitter = drive.fitter();
  return speed_law(fitter, fitter.refine(members));
}
std::shared_ptr<Effect> fan() {
  return effect_with("fan_load", {{"coefficient_Nms2", 1e-4}});
}
std::shared_ptr<Effect> friction() {
  return effect_with("coulomb_friction", {{"torque_Nm", 0.1}});
}

// In one direction a fan, a constant load and a Stribeck friction follow the cube together.
TEST(SpeedLaw, ACubicLoadInOneDirectionIsNoneOfTheCatalogue) {
  SyntheticDrive d = with_power(3, 0.3);
  d.omega_more = 75;
  d.duration_s = 4;
  const TraceResult r = trace_of(simulate_synthetic(d));
  EXPECT_EQ(kinds(r), Names{});
  EXPECT_EQ(r.verdict, "unexplained");
  EXPECT_NE(
      r.sentence.find("a torque in proportion to |omega_m|^3 explains the fitted rows better"),
      std::string::npos)
      << r.sentence;
}

TEST(SpeedLaw, AFanIsAFan) {
  EXPECT_FALSE(law_of(with_power(2, 1), {fan()}));
}

TEST(SpeedLaw, AFanAndAFrictionAreNoOtherLaw) {
  SyntheticDrive d;
  d.extra_load = [](double, double, double omega) {
    return 0.5 * omega * std::abs(omega) / (kFast * kFast) + 0.3 * std::tanh(omega / 0.02);
  };
  EXPECT_FALSE(law_of(d, {fan(), friction()}));
}

// The law is fitted beside the other members, whose sizes change with it.
TEST(SpeedLaw, TheOtherMembersAreFittedBesideIt) {
  SyntheticDrive d = with_power(3, 1);
  d.J += 2e-3;
  const auto law = law_of(d, {fan(), effect_with("inertia", {{"change_kgm2", 1e-3}})});
  ASSERT_TRUE(law);
  EXPECT_EQ(law->members, std::vector<std::size_t>{0});
  EXPECT_NEAR(law->exponent, 3, 0.1);
}

// An exponent near one of the catalogue's is an error of the data, not another law.
TEST(SpeedLaw, ASmallOffsetOfTheExponentIsNoLaw) {
  EXPECT_FALSE(law_of(with_power(2.1, 1), {fan()}));
}

TEST(SpeedLaw, AFrictionIsNoLoadStepsAtItsReversals) {
  Record record;
  record.T_s = 1e-3;
  for (int k = 0; k < 6000; ++k) {
    record.t.push_back(1e-3 * k);
    record.theta_m.push_back(-std::cos(kTwoPi * 0.25 * record.t.back()));  // reverses at 2 and 4 s
    record.motion_ok.push_back(1);
  }
  const auto step = [](double t, double torque) {
    return effect_with("load_step", {{"time_s", t}, {"torque_Nm", torque}});
  };
  const Members at{step(2.02, -0.3), step(3.1, 0.2), step(3.98, 0.3)};
  EXPECT_EQ(steps_at_reversals(record, at), (std::vector<std::size_t>{0, 2}));
  EXPECT_TRUE(steps_at_reversals(record, {step(2.02, 0.3), step(3.98, 0.3)}).empty());
  EXPECT_TRUE(steps_at_reversals(record, {step(2.02, -0.3), step(3.1, 0.2)}).empty());
}

}  // namespace
}  // namespace twinrate
