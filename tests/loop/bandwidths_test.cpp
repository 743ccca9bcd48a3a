// Suggested bandwidths: what the simulated drive does with them.
#include "loop/bandwidths.hpp"

#include <gtest/gtest.h>

#include "loop/load_drive.hpp"
#include "model/per_unit.hpp"
#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

// Truth as angle, no load at first, rated torque as a step; the speed loop of the suggestion.
TEST(Bandwidths, AStepOfRatedTorqueDipsAsMuchAndAsSoonAsSaid) {
  for (const char* preset : {"niewiara2020", "wittenstein_premo_3f", "siemens_1ft7044"}) {
    const std::vector<std::string> common = {
        "controller.kind=foc", "controller.angle_source=truth", "controller.compensation=off",
        "start=aligned",       "reference.slew_rad_s2=0",       "effect=[]"};
    Config drive = load_drive(preset, common);
    const Bandwidths b = suggest_bandwidths(drive);
    const DriveConfig& d = drive.drive();
    const double T = d.machine.T_rated, t_step = 0.4;
    std::vector<std::string> keys = common;
    keys.insert(keys.end(),
                {fmt::format("controller.foc.current_bandwidth_Hz={}", b.current_Hz),
                 fmt::format("controller.foc.speed_bandwidth_Hz={}", b.speed_Hz),
                 fmt::format("controller.foc.i_max_A={}", 10 * d.machine.i_rated),
                 fmt::format("reference.speed_rpm={}", 0.2 * d.machine.omega_m_rated * 60 / kTwoPi),
                 fmt::format("load.T_load_Nm=[[0.0, 0.0], [{}, {}]]", t_step, T),
                 "load.slew_Nm_s=0", fmt::format("run.duration_s={}", t_step + 2 * b.dip_at_s)});
    ClosedLoop loop(load(preset, keys));
    double before = 0, least = 1e9, at = 0;
    for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
      loop.tick();
      if (loop.t_s() < t_step) before = loop.truth().omega_m;
      if (loop.truth().omega_m < least && loop.t_s() > t_step)
        least = loop.truth().omega_m, at = loop.t_s();
    }
    EXPECT_NEAR(before - least, b.dip_rad_s, 0.15 * b.dip_rad_s) << preset;
    EXPECT_NEAR(at - t_step, b.dip_at_s, 0.25 * b.dip_at_s) << preset;
  }
}

TEST(Bandwidths, TheSpeedLoopStaysBelowTheFilterThatItRunsOn) {
  Config config = load_drive("beckhoff_am8122");
  const Bandwidths b = suggest_bandwidths(config);
  ASSERT_TRUE(b.filter_Hz);
  EXPECT_LT(b.speed_Hz, *b.filter_Hz);
  EXPECT_LT(b.speed_most_Hz, b.speed_least_Hz);  // this drive cannot have both
  Config measured = load_drive("maxon_ecmax40");
  EXPECT_FALSE(suggest_bandwidths(measured).filter_Hz);
}

TEST(Bandwidths, AnotherDelayScalesTheCurrentLoop) {
  const auto current = [](const char* delay) {
    Config config = load_drive("niewiara2020", {std::string("plant.delay_samples=") + delay});
    return suggest_bandwidths(config).current_Hz;
  };
  EXPECT_NEAR(current("1"), 10e3 / 25, 1e-9);
  EXPECT_NEAR(current("2") / current("1"), 1.5 / 2.5, 1e-12);
}

}  // namespace
}  // namespace twinrate::test
