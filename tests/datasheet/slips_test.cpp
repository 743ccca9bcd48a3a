// check names a slip of a drive file, and says nothing of a right one.
#include "loop/slips.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "model/frames.hpp"

namespace twinrate::test {
namespace {

std::vector<Slip> slips(const DriveConfig& d) {
  return slips_of(d, std::nullopt, std::nullopt);
}

bool says(const std::vector<Slip>& slips, const std::string& key, const std::string& text) {
  for (const Slip& slip : slips)
    if (slip.key == key && slip.what.find(text) != std::string::npos) return true;
  return false;
}

TEST(Slips, NoneInThePresets) {
  for (const std::string& preset : preset_names())
    EXPECT_TRUE(slips(load_drive(preset).drive()).empty()) << preset;
}

TEST(Slips, TheTorqueOfAnotherConventionIsNamedByItsFactor) {
  for (const auto& [factor, name] :
       {std::pair(std::sqrt(3.0), "sqrt(3)"), std::pair(1 / std::sqrt(2.0), "sqrt(2)"),
        std::pair(2.0, "poles or pole pairs"), std::pair(1.5, "3/2")}) {
    DriveConfig d = load_drive("niewiara2020").drive();
    d.machine.T_rated = largest_torque(d.machine, d.machine.i_rated) * factor;
    EXPECT_TRUE(says(slips(d), "machine.T_rated_Nm", name)) << name;
  }
}

TEST(Slips, AReluctanceTorqueIsNoSlip) {
  const MachineParameters m = load_drive("kim-ipmsm").drive().machine;
  EXPECT_NEAR(largest_torque(m, m.i_rated), m.T_rated, 0.02 * m.T_rated);
  EXPECT_GT(m.T_rated, 1.1 * m.torque_constant() * m.i_rated);
}

TEST(Slips, AnInertiaInGramSquareCentimetresIsNamed) {
  DriveConfig d = load_drive("niewiara2020").drive();
  d.machine.J *= 1e7;
  EXPECT_TRUE(says(slips(d), "machine.J_kgm2", "g cm2"));
  d.machine.J *= 1e-3;
  EXPECT_TRUE(says(slips(d), "machine.J_kgm2", "kg cm2"));
}

TEST(Slips, AnEmfAboveTheBusIsNamed) {
  DriveConfig d = load_drive("niewiara2020").drive();
  d.machine.psi_f = 1.3 * d.inverter.u_max_linear() / (d.machine.n_p * d.machine.omega_m_rated);
  EXPECT_TRUE(says(slips(d), "machine.psi_f_Wb", "line to line or phase"));
}

TEST(Slips, BandwidthsBeyondTheRatesAreWarnedOf) {
  Config config = load_drive("dilys2021", {"controller.foc.current_bandwidth_Hz=600",
                                           "controller.foc.speed_bandwidth_Hz=400"});
  std::string all;
  for (const Warning& warning : check_runnable(config)) all += warning.text + "\n";
  EXPECT_NE(all.find("current_bandwidth_Hz: 600 Hz: f_s allows 555.6 Hz"), std::string::npos)
      << all;
  EXPECT_NE(all.find("speed_bandwidth_Hz: 400 Hz: the current loop allows 300 Hz"),
            std::string::npos);
}

}  // namespace
}  // namespace twinrate::test
