// Every preset closes its loop.
#include <gtest/gtest.h>

#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

class EveryPreset : public testing::TestWithParam<std::string> {};

TEST_P(EveryPreset, LocksAndReachesItsReferenceSpeed) {
  ClosedLoop loop(load(GetParam()));
  const Figures figures = run(loop);
  EXPECT_TRUE(figures.held());
  EXPECT_LT(degrees(figures.angle_error_max), 10);
  const double omega_m_ref = loop.reference().omega_m_ref;
  EXPECT_NEAR(figures.speed_mean, omega_m_ref, 0.02 * std::abs(omega_m_ref));
}

TEST_P(EveryPreset, StatesItsRatesOnce) {
  const DriveConfig drive = drive_of(GetParam());
  EXPECT_NEAR(drive.rates.f_b_Hz * drive.rates.n, drive.rates.f_s_Hz, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(Config, EveryPreset, testing::ValuesIn(preset_names()),
                         [](const auto& i) { return gtest_name(i.param); });

TEST(Locked, IsFalseForARunBelowItsReferenceSpeed) {
  // The current limit of 0.05 A cannot hold half load: the angle is known, the speed is far off.
  const Figures figures = run("dilys2021", {"controller.foc.i_max_A=0.05", "load.T_load_Nm=0.0315",
                                            "controller.angle_source=truth"});
  EXPECT_FALSE(figures.held());
}

TEST(AngleSource, TruthMeasuredAndEstimateAllReachTheSpeed) {
  for (const char* source : {"truth", "measured", "estimate"}) {
    const Figures figures = run("dilys2021", {fmt::format("controller.angle_source={}", source)});
    EXPECT_NEAR(figures.speed_mean, 100, 0.5) << source;
    EXPECT_TRUE(figures.held()) << source;
  }
}

}  // namespace
}  // namespace twinrate::test
