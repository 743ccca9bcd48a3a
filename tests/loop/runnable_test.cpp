// Checked means runnable: what cannot run is refused, and what theory expects to be lost is warned
// of.
#include "loop/runnable.hpp"

#include <gtest/gtest.h>

#include <chrono>

#include "loop/load_drive.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::test {
namespace {

std::vector<std::string> checked(const std::string& preset, const Overrides& overrides) {
  Config config = load_drive(preset, overrides);
  return check_runnable(config);
}

std::string refusal(const std::string& preset, const Overrides& overrides) {
  try {
    checked(preset, overrides);
  } catch (const BadInput& error) {
    return error.what();
  }
  return "";
}

bool warns(const std::string& preset, const Overrides& overrides, const std::string& of) {
  for (const std::string& warning : checked(preset, overrides))
    if (warning.find("may lose synchronism") != std::string::npos &&
        warning.find(of) != std::string::npos)
      return true;
  return false;
}

TEST(Runnable, ThePresetsRunWithoutAWarning) {
  for (const char* preset : {"dilys2021", "niewiara2020", "kim-ipmsm"})
    EXPECT_TRUE(checked(preset, {}).empty()) << preset;
}

TEST(Runnable, AKeyThatNoPartReadsIsRefusedByName) {
  EXPECT_EQ(refusal("dilys2021", {"controller.compensation=load"}),
            "--set: controller.compensation: has no effect here; it is read with an estimator.kind "
            "that estimates the load, ekf_sensorless does not");
  for (const auto& [preset, key] :
       {std::pair("kim-ipmsm", "estimator.covariance=sequential"),
        std::pair("dilys2021", "controller.foc.startup.t_align_s=0.2"),
        std::pair("dilys2021", "estimator.dq_ekf.R=1e-3"),
        std::pair("niewiara2020", "controller.lqr.Q_d=[1.0, 2.0]"),
        std::pair("dilys2021", "gain.speed_span_rad_s=100"),
        std::pair("dilys2021", "controller.foc.synchronism.nis_limit=5"),
        std::pair("dilys2021", "inverter.f_pwm_Hz=10000")}) {
    const std::string name = std::string(key).substr(0, std::string(key).find('='));
    EXPECT_NE(refusal(preset, {key}).find(name), std::string::npos) << key;
  }
  EXPECT_EQ(refusal("dilys2021", {"start=align_if", "controller.foc.startup.t_align_s=0.2"}), "");
}

TEST(Runnable, CompensationIsRefusedWhereNoPartCanDoIt) {
  EXPECT_EQ(refusal("niewiara2020", {"controller.kind=foc", "controller.compensation=load"}), "");
  EXPECT_NE(refusal("niewiara2020", {"controller.kind=foc", "controller.compensation=angle_domain"})
                .find("controller.kind = lqr"),
            std::string::npos);
  EXPECT_EQ(refusal("niewiara2020", {"controller.compensation=angle_domain"}), "");
  EXPECT_NE(refusal("niewiara2020",
                    {"controller.compensation=angle_domain", "estimator.kind=ekf_sensorless"})
                .find("a measured angle"),
            std::string::npos);
}

TEST(Runnable, AResolvedFileRunsThoughItHoldsEveryKey) {
  const Config config = load("dilys2021", {});
  EXPECT_NE(config.resolved().find("# resolved by twinrate"), std::string::npos);
}

// L = -700 Nm/rad belongs to 8.8e-3 kgm2: -J f_s^2 is -250 on the rotor of dilys2021.
TEST(Runnable, AnIntegralGainOfAnotherMotorIsRefused) {
  const Overrides other{"estimator.kind=ekf_disturbance"};
  EXPECT_EQ(refusal("dilys2021", other), "") << "the default fits the machine";
  EXPECT_NE(refusal("dilys2021",
                    {"estimator.kind=ekf_disturbance", "estimator.ekf_disturbance.L_Nm_rad=-700"})
                .find("-250 to 0 allowed"),
            std::string::npos);
}

// The measured limits are n = 12 (docs/find-fbmin.md), and 4 of `eemf` at 66.7 Hz and 10 kHz.
TEST(Runnable, WarnsBeyondTheLargestNThatTheoryHolds) {
  EXPECT_FALSE(warns("dilys2021", {"rates.n=12"}, "n = 12"));
  EXPECT_TRUE(warns("dilys2021", {"rates.n=13"}, "n = 12"));
  EXPECT_TRUE(warns("dilys2021", {"rates.n=10", "controller.kind=lqr"}, "rates.n"));
  const Overrides eemf{"estimator.kind=eemf", "start=flying", "rates.n=4"};
  EXPECT_FALSE(warns("kim-ipmsm", eemf, "rates.n"));
  EXPECT_TRUE(warns("kim-ipmsm", {eemf[0], eemf[1], "rates.n=5"}, "n = 4"));
  EXPECT_FALSE(warns("dilys2021", {"rates.n=100", "gain.policy=rotate"}, "rates.n"));
}

TEST(Runnable, WarnsOfASpeedAtWhichASensorlessFilterSeesNothing) {
  EXPECT_TRUE(warns("niewiara2020", {"estimator.kind=dq_ekf"}, "EMF"));
  EXPECT_FALSE(warns("niewiara2020", {"estimator.kind=dq_ekf", "reference.speed_rpm=500"}, "EMF"));
  EXPECT_FALSE(warns("niewiara2020", {}, "EMF")) << "it has a position sensor";
}

TEST(Runnable, WarnsOfAFilterOutsideItsStatedLimits) {
  EXPECT_TRUE(warns("kim-ipmsm", {"estimator.kind=backemf_printed"}, "saliency"));
  EXPECT_FALSE(warns("kim-ipmsm", {"estimator.kind=backemf_printed", "plant.saliency=fixed_axes"},
                     "saliency"));
  const Overrides slow{"estimator.kind=active_flux", "start=flying",
                       "controller.foc.speed_bandwidth_Hz=15"};
  EXPECT_FALSE(warns("kim-ipmsm", slow, "speed loop"));
  EXPECT_TRUE(warns("kim-ipmsm", {slow[0], slow[1]}, "speed loop"));
}

TEST(Runnable, TakesNoTableOverSpeed) {
  const auto begun = std::chrono::steady_clock::now();
  checked("niewiara2020", {"estimator.kind=ekf_harmonic", "gain.policy=scheduled"});
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(2));
}

}  // namespace
}  // namespace twinrate::test
