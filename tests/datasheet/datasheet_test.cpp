// A drive file from data-sheet values: each convention against the physics that defines it.
#include <gtest/gtest.h>

#include <cmath>
#include <sstream>

#include "core/config.hpp"
#include "datasheet/drive_of_sheet.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "tests/datasheet/sheets.hpp"
#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

using Pairs = std::vector<std::string>;

const Pairs kServo = {"poles=8",
                      "ke_V_krpm=28",
                      "ke_convention=line_rms",
                      "r_ll_Ohm=1.2",
                      "l_ll_H=4.2e-3",
                      "inertia_kgm2=3e-5",
                      "rated_torque_Nm=1.27",
                      "rated_current_A_rms=2.7",
                      "rated_speed_rpm=3000",
                      "v_dc_V=310"};

Pairs with(Pairs pairs, const Pairs& more) {
  for (const std::string& pair : more) {
    const std::string key = pair.substr(0, pair.find('='));
    std::erase_if(pairs, [&](const std::string& p) { return p.starts_with(key + "="); });
    if (!pair.ends_with("=")) pairs.push_back(pair);  // "key=" only takes the key away
  }
  return pairs;
}

MachineOfSheet machine(const Pairs& more) {
  return machine_of_sheet(read_sheet(with(kServo, more)));
}

std::string refusal(const Pairs& more) {
  try {
    machine(more);
  } catch (const BadInput& error) {
    return error.what();
  }
  return "";
}

// The voltage that an instrument would show at this speed, from the flux linkage.
double shown_voltage(const MachineParameters& m, double rpm, bool line, bool rms) {
  const double phase_peak = m.psi_f * m.n_p * rpm * kTwoPi / 60;
  return phase_peak * (line ? std::sqrt(3.0) : 1) / (rms ? std::sqrt(2.0) : 1);
}

TEST(Datasheet, AnEmfConstantInAnyConventionIsTheVoltageThatAnInstrumentShows) {
  for (const auto& [name, line, rms] :
       {std::tuple("line_peak", true, false), std::tuple("line_rms", true, true),
        std::tuple("phase_peak", false, false), std::tuple("phase_rms", false, true)}) {
    const auto by_ke = machine({"ke_convention=" + std::string(name)}).machine;
    EXPECT_NEAR(shown_voltage(by_ke, 1000, line, rms), 28, 1e-9) << name;
    const auto by_kv = machine({"ke_V_krpm=", "ke_convention=", "kv_rpm_V=150",
                                "kv_convention=" + std::string(name)})
                           .machine;
    EXPECT_NEAR(shown_voltage(by_kv, 150, line, rms), 1, 1e-12) << name;
  }
}

TEST(Datasheet, ATorqueConstantIsTheTorqueOfAnAmpere) {
  for (const auto& [name, peak] : {std::pair("peak", 1.0), std::pair("rms", std::sqrt(2.0))}) {
    const auto m = machine({"ke_V_krpm=", "ke_convention=", "kt_Nm_A=0.47",
                            "kt_convention=" + std::string(name)})
                       .machine;
    EXPECT_NEAR(m.torque(0, peak), 0.47, 1e-12) << name;
  }
}

TEST(Datasheet, ABlockCommutatedConstantIsThePowerOfTheEmfBetweenTwoLines) {
  // K_t = 1/K_v in SI units, as maxon prints both; the current of equal loss makes equal torque.
  const Pairs block = {"ke_V_krpm=",      "ke_convention=",       "kv_rpm_V=236",
                       "kt_Nm_A=",        "rated_current_A_rms=", "rated_current_A_block=3.29",
                       "rated_torque_Nm="};
  const auto m = machine(block).machine;
  const double kt = 60 / (kTwoPi * 236), i = m.i_rated;
  EXPECT_NEAR(std::sqrt(3.0) * m.psi_f * m.n_p, kt, 1e-9);
  EXPECT_NEAR(1.5 * m.R_s * i * i, 2 * m.R_s * 3.29 * 3.29, 1e-9);
  EXPECT_NEAR(m.torque(0, i), kt * 3.29, 1e-9);
  Pairs both = block;
  both[3] = "kt_Nm_A=0.0404";
  EXPECT_TRUE(machine(both).doubts.empty());
  both.push_back("kt_convention=peak");
  EXPECT_FALSE(machine(both).doubts.empty());
}

TEST(Datasheet, TheElectricalPowerOfTheEmfIsTheMechanicalOne) {
  const auto m = machine({}).machine;  // a servo motor whose sheet gives K_t = 0.46 Nm/A rms
  const double omega_m = 100, i = 2;
  EXPECT_NEAR(1.5 * m.psi_f * m.n_p * omega_m * i, m.torque(0, i) * omega_m, 1e-9);
  EXPECT_NEAR(m.torque_constant() * std::sqrt(2.0), 0.463, 0.001);
}

TEST(Datasheet, PhaseLineAndCommonUnitsAreConverted) {
  const auto m = machine({"inertia_kgm2=", "inertia_gcm2=300"}).machine;
  EXPECT_EQ(m.n_p, 4);
  EXPECT_DOUBLE_EQ(m.R_s, 0.6);
  EXPECT_DOUBLE_EQ(m.L_q, 2.1e-3);
  EXPECT_DOUBLE_EQ(m.J, 3e-5);
  EXPECT_NEAR(m.i_rated, 2.7 * std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(m.omega_m_rated, 100 * M_PI, 1e-9);
}

// One motor in inches and ounces, and in SI: 1 oz in = 7.06155e-3 Nm (NIST SP 811).
TEST(Datasheet, AValueWithItsUnitIsConvertedAndSaid) {
  const Sheet inches =
      read_sheet({"kt_Nm_A=5.35oz-in/A", "inertia_kgcm2=0.001 oz-in-s^2", "ke_V_krpm=4.64mV/rpm",
                  "l_ll_H=0.4mH", "r_ll_Ohm=720 mOhm", "rated_torque_Nm=35 oz.in",
                  "rated_speed_rpm=418.88rad/s", "v_dc_V=24V", "kv_rpm_V=215.5 rpm/V",
                  "mechanical_time_constant_ms=0.0026s", "rated_current_A_peak=7100mA"});
  EXPECT_NEAR(*inches["kt_Nm_A"], 0.0377793, 1e-7);
  EXPECT_NEAR(*inches["inertia_kgcm2"], 0.0706155, 1e-7);
  EXPECT_NEAR(*inches["ke_V_krpm"], 4.64, 1e-12);
  EXPECT_NEAR(*inches["l_ll_H"], 0.4e-3, 1e-15);
  EXPECT_NEAR(*inches["r_ll_Ohm"], 0.72, 1e-12);
  EXPECT_NEAR(*inches["rated_torque_Nm"], 0.247154, 1e-6);
  EXPECT_NEAR(*inches["rated_speed_rpm"], 4000, 0.1);
  EXPECT_NEAR(*inches["mechanical_time_constant_ms"], 2.6, 1e-12);
  EXPECT_NEAR(*inches["rated_current_A_peak"], 7.1, 1e-12);
  EXPECT_EQ(inches.conversions().size(), 8u);  // mV/rpm is V/krpm; V, rpm/V as the key says
  EXPECT_NEAR(*read_sheet({"inertia_gcm2=1 lb-in2"})["inertia_gcm2"], 2926.3965, 1e-3);
  EXPECT_NEAR(*read_sheet({"ke_V_krpm=1 V\xc2\xb7s/rad"})["ke_V_krpm"], 104.719755, 1e-6);
  EXPECT_NEAR(*read_sheet({"kt_Nm_A=1 lb-ft/A"})["kt_Nm_A"], 1.355818, 1e-6);
  EXPECT_NE(refusal({"kt_Nm_A=5oz-in"}).find("\"oz-in\" is no unit of it; known: nm/a"),
            std::string::npos);
  EXPECT_NE(refusal({"kt_Nm_A=5Nm/Arms"}).find("is no unit of it"), std::string::npos);
  EXPECT_NE(refusal({"poles=8 poles"}).find("is no unit of it"), std::string::npos);
  EXPECT_NE(refusal({"kt_ozin_A=5"}).find("unknown key; kt_Nm_A allowed, and behind the number"),
            std::string::npos);
  EXPECT_NE(refusal({"rated_torque_ozin=5"}).find("unknown key; rated_torque_Nm allowed"),
            std::string::npos);
}

TEST(Datasheet, EveryConversionAndEveryAssumptionIsSaid) {
  const MachineOfSheet s = machine({"ke_convention="});
  EXPECT_EQ(s.conversions.size(), 6u);  // n_p, R_s, L, i_rated, psi_f, speed
  bool said = false;
  for (const std::string& line : s.assumed)
    said = said || line.find("ke_convention = line_rms") != std::string::npos;
  EXPECT_TRUE(said);
}

TEST(Datasheet, ConstantsThatContradictEachOtherAreDoubtedWithTheFactor) {
  // K_t per ampere rms of the same motor, taken for one per ampere peak.
  const MachineOfSheet s = machine({"kt_Nm_A=0.463", "kt_convention=peak"});
  ASSERT_EQ(s.doubts.size(), 1u);
  EXPECT_NE(s.doubts[0].find("sqrt(2)"), std::string::npos) << s.doubts[0];
  EXPECT_TRUE(machine({"kt_Nm_A=0.463", "kt_convention=rms"}).doubts.empty());
}

// A motor with block commutation, I direct through two phases: its EMF of two lines times I is its
// power, and FOC with the same copper loss gives the same torque.
TEST(Datasheet, ConstantsOfBlockCommutationAreThoseOfTwoPhases) {
  const Pairs sheet = {"ke_V_krpm=",     "ke_convention=",       "kv_rpm_V=304",
                       "kt_Nm_A=0.0314", "rated_current_A_rms=", "rated_current_A_block=3.27"};
  const MachineOfSheet s = machine(sheet);
  EXPECT_TRUE(s.doubts.empty());
  const MachineParameters& m = s.machine;
  EXPECT_NEAR(shown_voltage(m, 304, true, false), 1, 1e-12);
  EXPECT_NEAR(2 * m.R_s * 3.27 * 3.27, 1.5 * m.R_s * m.i_rated * m.i_rated, 1e-12);
  EXPECT_NEAR(m.torque(0, m.i_rated), 0.0314 * 3.27, 0.001 * 0.1);
  // Taken for one per ampere rms, the doubt names the convention.
  const MachineOfSheet rms =
      machine(with(sheet, {"rated_current_A_block=", "rated_current_A_rms=3.27"}));
  ASSERT_EQ(rms.doubts.size(), 1u);
  EXPECT_NE(rms.doubts[0].find("kt_convention = block"), std::string::npos) << rms.doubts[0];
}

TEST(Datasheet, ASlipIsOneLineWithWhatIsAllowed) {
  EXPECT_EQ(refusal({"poles=7"}), "data sheet: poles: an even number allowed, found 7");
  EXPECT_EQ(refusal({"v_dc_V=48W"}), "data sheet: v_dc_V: \"W\" is no unit of it; known: v, kv");
  EXPECT_EQ(refusal({"v_dc_V=0.5V"}),
            "data sheet: v_dc_V: a number from 1 to 10000 allowed, found 0.5V");
  EXPECT_EQ(refusal({"v_dc_V="}), "data sheet: v_dc_V is required");
  EXPECT_EQ(refusal({"n_p=5"}),
            "data sheet: n_p = 5 and poles = 8 contradict each other; one of them allowed");
  EXPECT_EQ(refusal({"ke_convention=rms"}),
            "data sheet: ke_convention: one of line_peak, line_rms, phase_peak, phase_rms allowed, "
            "found rms");
  EXPECT_NE(refusal({"rated_current_A=3"})
                .find("rated_current_A_rms or rated_current_A_peak or rated_current_A_block"),
            std::string::npos);
  EXPECT_NE(refusal({"r_Ohm=3"}).find("unknown key; r_ll_Ohm or r_phase_Ohm allowed"),
            std::string::npos);
  EXPECT_NE(refusal({"colour=3"}).find("unknown key; known: poles, n_p"), std::string::npos);
  EXPECT_NE(refusal({"v_dc_V=nan"}), "");
}

TEST(Datasheet, AskedOnATerminalItIsTheSameSheet) {
  // poles, kv, ke, ke_convention, kt, R, L ..: a wrong answer is asked again; n_p after the poles,
  // and phase values after those of two lines, are not asked.
  std::istringstream in(
      "8\n\n28\nrms\nline_rms\n\n1.2\n4.2e-3\n\n\n3e-5\n2.7\n1.27\n3000\n310\n\n\n\n");
  std::ostringstream out;
  const MachineParameters asked = machine_of_sheet(ask_for_sheet(in, out)).machine;
  const MachineParameters given = machine({}).machine;
  EXPECT_EQ(asked.psi_f, given.psi_f);
  EXPECT_EQ(asked.J, given.J);
  EXPECT_NE(out.str().find("found rms"), std::string::npos);
  EXPECT_EQ(out.str().find("kv_convention"), std::string::npos) << "asked without a kv";
}

TEST(Datasheet, TheDriveFileHoldsItsMotorInStep) {
  for (const Pairs& more : {Pairs{}, Pairs{"encoder_counts=4096"}}) {
    const DriveOfSheet drive = drive_of_sheet("servo", read_sheet(with(kServo, more)));
    EXPECT_TRUE(drive.warnings.empty());
    Config config = Config::parse(drive.toml, "servo.toml");
    read_all_tables(config);
    EXPECT_NEAR(config.drive().machine.psi_f, machine({}).machine.psi_f, 1e-6);
    twinrate::ClosedLoop loop(config);
    const TickRecord* tick = nullptr;
    for (std::int64_t k = 0; k < config.drive().steps(); ++k) tick = &loop.step();
    const double omega_m = config.drive().reference.speed_rpm.at(0) * kTwoPi / 60;
    EXPECT_NEAR(tick->truth.omega_m, omega_m, 0.02 * omega_m);
    EXPECT_LT(std::abs(wrap_pi(tick->estimate.theta_e -
                               config.drive().machine.n_p * tick->truth.theta_m)),
              0.1);
    EXPECT_GT(tick->truth.T_load, 0.3);
  }
}

TEST(Datasheet, TheFirstRunLoadsASensorlessMotorAfterItsHandOver) {
  // A flywheel of 100 times the rotor's inertia: alignment and ramp take 21 s.
  const DriveOfSheet made = drive_of_sheet(
      "flywheel", read_sheet({"poles=14", "kv_rpm_V=150", "r_phase_Ohm=0.039", "l_phase_H=24e-6",
                              "inertia_gcm2=250000", "rated_current_A_peak=30", "v_dc_V=24"}));
  EXPECT_TRUE(made.warnings.empty());
  Config config = Config::parse(made.toml, "flywheel.toml");
  read_all_tables(config);
  const DriveConfig& drive = config.drive();
  const double hand_over_s = start_takes_s(config);
  EXPECT_GT(hand_over_s, 20);
  EXPECT_GT(drive.load.T_load_Nm.steps().at(1).t_s, hand_over_s);
  EXPECT_GT(drive.run.settle_s, hand_over_s);
}

TEST(KnownSheets, EachBecomesADriveFileWithoutAWarningThatHoldsItsMotorInStep) {
  ASSERT_GE(known_sheets().size(), 20u);
  const std::vector<std::string> presets = preset_names();
  for (const KnownSheet& known : known_sheets()) {
    SCOPED_TRACE(known.motor + ", " + known.source);
    const DriveOfSheet drive = drive_of_sheet(known.preset, read_sheet(known.pairs));
    EXPECT_TRUE(drive.doubts.empty()) << drive.doubts.front();
    EXPECT_TRUE(drive.warnings.empty()) << drive.warnings.front();
    if (std::count(presets.begin(), presets.end(), known.preset) > 0) continue;  // presets_test
    Config config = Config::parse(drive.toml, known.preset);
    read_all_tables(config);
    test::ClosedLoop loop(std::move(config));
    const Figures figures = run(loop);
    EXPECT_TRUE(figures.held());
    EXPECT_LT(figures.angle_error_max, 0.1);
    const double omega_m_ref = loop.reference().omega_m_ref;
    EXPECT_NEAR(figures.speed_mean, omega_m_ref, 0.02 * omega_m_ref);
  }
}

TEST(KnownSheets, TenArePresetsWithTheMachineOfTheirSheet) {
  const std::vector<std::string> presets = preset_names();
  int found = 0;
  for (const KnownSheet& known : known_sheets()) {
    if (std::count(presets.begin(), presets.end(), known.preset) == 0) continue;
    ++found;
    Config made =
        Config::parse(drive_of_sheet(known.preset, read_sheet(known.pairs)).toml, known.preset);
    read_all_tables(made);
    EXPECT_TRUE(load_drive(known.preset).resolved() == made.resolved())
        << known.preset << " is not what machine new writes";
  }
  EXPECT_EQ(found, 10);
}

}  // namespace
}  // namespace twinrate::test
