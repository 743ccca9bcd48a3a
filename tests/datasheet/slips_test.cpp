// check names a slip of a drive file, and says nothing of a right one.
#include "loop/slips.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "datasheet/drive_of_sheet.hpp"
#include "loop/demand.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "model/frames.hpp"
#include "tests/datasheet/sheets.hpp"

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

// A sheet without rated torque and speed; the first run would take 1.3e6 s.
TEST(Slips, AnInertiaInGramSquareCentimetresIsNamedByANewFile) {
  const DriveOfSheet drive = drive_of_sheet(
      "drone", read_sheet({"poles=14", "kv_rpm_V=1750", "r_ll_Ohm=46mOhm", "l_ll_H=14uH",
                           "inertia_kgm2=38", "rated_current_A_block=16", "v_dc_V=16.8"}));
  ASSERT_FALSE(drive.warnings.empty());
  EXPECT_NE(drive.warnings[0].find("g cm2 (1e-7 kg m2)?"), std::string::npos) << drive.warnings[0];
}

TEST(Slips, AnInductanceInMillihenryIsNamed) {
  DriveConfig d = load_drive("niewiara2020").drive();
  d.machine.L_d = d.machine.L_q = 1e3 * d.machine.L_d;
  EXPECT_TRUE(says(slips(d), "machine.L_d_H", "mH (1e-3 H)?"));
}

TEST(Slips, ATorqueInOunceInchIsNamed) {
  DriveConfig d = load_drive("niewiara2020").drive();
  d.machine.T_rated = 0.95 * largest_torque(d.machine, d.machine.i_rated) / 7.0615518e-3;
  EXPECT_TRUE(says(slips(d), "machine.T_rated_Nm", "141.6, Nm or oz in?"));
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

// The drive of a known sheet, loaded, with keys of its file changed.
Config drive_of(const KnownSheet& known, const std::vector<std::string>& overrides) {
  Config config = Config::parse(drive_of_sheet(known.preset, read_sheet(known.pairs)).toml,
                                known.preset, overrides);
  read_all_tables(config);
  return config;
}

std::string joined(const std::vector<std::string>& lines) {
  std::string all;
  for (const std::string& line : lines) all += line + "\n";
  return all;
}

TEST(SlipsOfKnownSheets, AFactorInTheFluxIsNamed) {
  for (const KnownSheet& known : known_sheets()) {
    const DriveConfig right = drive_of(known, {}).drive();
    for (const auto& [factor, name] : {std::pair(std::sqrt(3.0), "sqrt(3), line to line or phase"),
                                       {std::sqrt(2.0), "sqrt(2), rms or peak"},
                                       {2.0, "2, poles or pole pairs"},
                                       {1.5, "1.5, the 3/2 of the torque"}}) {
      for (const double wrong : {factor, 1 / factor}) {
        DriveConfig d = right;
        d.machine.psi_f *= wrong;
        EXPECT_TRUE(says(slips(d), "machine.T_rated_Nm", name))
            << known.motor << ", " << name << " " << wrong;
      }
    }
  }
}

TEST(SlipsOfKnownSheets, PolesForPolePairsAreNamedWhereTheFluxLinkageIsGiven) {
  for (const KnownSheet& known : known_sheets()) {
    DriveConfig d = drive_of(known, {}).drive();
    d.machine.n_p *= 2;
    EXPECT_TRUE(says(slips(d), "machine.T_rated_Nm", "poles or pole pairs")) << known.motor;
  }
}

TEST(SlipsOfKnownSheets, GramSquareCentimetresForKilogramSquareMetresAreNamed) {
  for (const KnownSheet& known : known_sheets()) {
    DriveConfig d = drive_of(known, {}).drive();
    d.machine.J *= 1e7;
    EXPECT_TRUE(says(slips(d), "machine.J_kgm2", "g cm2")) << known.motor;
  }
}

// Where the sheet gives the torque, too: one constant alone contradicts nothing.
TEST(SlipsOfKnownSheets, AnEmfConstantOfTheOtherVoltageIsNamed) {
  int one_constant = 0;
  for (const KnownSheet& known : known_sheets()) {
    const auto tells_torque = [](const std::string& p) {
      return p.starts_with("kt_Nm_A") || p.starts_with("rated_torque_Nm");
    };
    if (std::none_of(known.pairs.begin(), known.pairs.end(), tells_torque)) {
      ++one_constant;
      continue;
    }
    for (const auto& [line, phase] :
         {std::pair("=line_rms", "=phase_rms"), std::pair("=line_peak", "=phase_peak")}) {
      std::vector<std::string> pairs = known.pairs;
      const auto convention =
          std::find_if(pairs.begin(), pairs.end(), [end = line](const std::string& p) {
            return p.find("convention") != std::string::npos && p.ends_with(end);
          });
      if (convention == pairs.end()) continue;
      convention->replace(convention->find('='), std::string::npos, phase);
      const DriveOfSheet drive = drive_of_sheet(known.preset, read_sheet(pairs));
      EXPECT_NE((joined(drive.doubts) + joined(drive.warnings)).find("sqrt(3)"), std::string::npos)
          << known.motor;
    }
  }
  EXPECT_EQ(one_constant, 3);
}

TEST(SlipsOfKnownSheets, AResistanceLineToLineIsSeenByTheMechanicalTimeConstant) {
  int sheets = 0;
  for (const KnownSheet& known : known_sheets()) {
    std::vector<std::string> pairs = known.pairs;
    for (std::string& pair : pairs)
      if (pair.starts_with("r_ll_Ohm")) pair = "r_phase_Ohm" + pair.substr(8);
    const auto printed = [](const std::string& p) { return p.starts_with("mechanical_time"); };
    if (pairs == known.pairs || std::none_of(pairs.begin(), pairs.end(), printed)) continue;
    ++sheets;
    EXPECT_NE(joined(drive_of_sheet(known.preset, read_sheet(pairs)).doubts)
                  .find("resistance line to line or phase"),
              std::string::npos)
        << known.motor;
  }
  EXPECT_EQ(sheets, 5);
}

TEST(SlipsOfKnownSheets, ALoadBeyondTheMachineAndBandwidthsBeyondTheRatesAreWarnedOf) {
  for (const KnownSheet& known : known_sheets()) {
    const DriveConfig d = drive_of(known, {}).drive();
    const auto warned = [&](const std::vector<std::string>& overrides) {
      Config config = drive_of(known, overrides);
      return joined(warnings_of(config, demand_of(config)));
    };
    const std::string all =
        warned({fmt::format("load.T_load_Nm={}", 2 * d.machine.T_rated),
                fmt::format("controller.foc.current_bandwidth_Hz={}", d.rates.f_s_Hz / 8)}) +
        warned(
            {"controller.foc.current_bandwidth_Hz=200", "controller.foc.speed_bandwidth_Hz=110"});
    for (const char* key : {"load.T_load_Nm: needs", "current_bandwidth_Hz", "speed_bandwidth_Hz"})
      EXPECT_NE(all.find(key), std::string::npos) << known.motor << "\n" << all;
  }
}

}  // namespace
}  // namespace twinrate::test
