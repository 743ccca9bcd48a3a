// Valid drive files and their configs. Invalid ones: config_refusal_test.cpp.
#include "core/config.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "controller/controller.hpp"
#include "core/bus_parameters.hpp"
#include "core/steering.hpp"
#include "estimator/registry.hpp"
#include "loop/load_drive.hpp"
#include "tests/core/drive_text.hpp"
#include "tests/support/drives.hpp"

namespace twinrate {
namespace {

using test::drive_text;
using test::parse;

// The parts of the drive, and the tables of kinds that are not chosen.
void read_every_table(Config& config) {
  make_filter(config);
  make_controller(config);
  const auto read_others = [&](const std::string& owner, const std::string& chosen,
                               const std::vector<std::string>& kinds, auto make_builder) {
    for (const std::string& kind : kinds) {
      const std::string table = fmt::format("{}.{}", owner, kind);
      if (kind == chosen || !config.has_table(table)) continue;
      const auto builder = make_builder(kind);
      config.read_table(table, [&](FieldVisitor& f) { builder->fields(f); });
    }
  };
  for (const OwnedTable& table : owned_tables()) config.read_table(table.path, table.fields);
  const DriveConfig& drive = config.drive();
  read_others("estimator", drive.estimator.kind, filter_kinds(),
              [&](const std::string& kind) { return filter_builder(kind, drive); });
  read_others("controller", drive.controller.kind, controller_kinds(),
              [&](const std::string& kind) { return controller_builder(kind, drive); });
}

class EveryPreset : public testing::TestWithParam<std::string> {};

TEST_P(EveryPreset, LoadsWithEveryTableRead) {
  Config config = Config::load(GetParam());
  EXPECT_EQ(config.drive().name, GetParam());
  read_every_table(config);
  EXPECT_NO_THROW(config.require_all_read());
}

TEST_P(EveryPreset, ResolvedTextIsAFixedPoint) {
  Config config = Config::load(GetParam());
  read_every_table(config);
  const std::string once = config.resolved();
  Config again = Config::parse(once, "resolved.toml");
  read_every_table(again);
  EXPECT_NO_THROW(again.require_all_read());
  EXPECT_EQ(again.resolved(), once);
}

INSTANTIATE_TEST_SUITE_P(Config, EveryPreset, testing::ValuesIn(preset_names()),
                         [](const auto& i) { return test::gtest_name(i.param); });

TEST(Presets, AreFoundByNameAndByFile) {
  const auto names = preset_names();
  EXPECT_NE(std::find(names.begin(), names.end(), "dilys2021"), names.end());
  const std::string path = preset_directory() + "/dilys2021.toml";
  EXPECT_EQ(Config::load(path).drive().machine.psi_f, 0.007);
  // By its file in the tree, wherever the program runs.
  EXPECT_EQ(Config::load("config/dilys2021.toml").drive().machine.psi_f, 0.007);
  EXPECT_THROW(Config::load("config/dilys2012.toml"), BadInput);
  EXPECT_THROW(Config::load("presets/dilys2021.toml"), BadInput);
}

TEST(Config, ReadsTheDilysMotorAsThePaperGivesIt) {
  const DriveConfig d = test::drive_of("dilys2021");
  EXPECT_EQ(d.machine.R_s, 1.2);
  EXPECT_EQ(d.machine.L_d, 0.5e-3);
  EXPECT_EQ(d.machine.n_p, 4);
  EXPECT_EQ(d.rates.f_s_Hz, 5000);
  EXPECT_EQ(d.rates.n, 5);
  EXPECT_EQ(d.rates.f_b_Hz, 1000);
  EXPECT_EQ(d.gain.policy, GainPolicy::kPaper);
  EXPECT_EQ(d.steps(), 10000);
  EXPECT_EQ(d.t_ns(3), 600000);
  EXPECT_NEAR(d.reference_at(0).omega_m_ref, 100, 1e-12);
}

TEST(Config, ResolvedTextKeepsWhatOverridesEffectsAndProfilesSay) {
  const auto complete = [](Config& config) {
    make_filter(config);
    make_controller(config);
    return config.resolved();
  };
  Config config = Config::parse(
      "preset = \"dilys2021\"\n"
      "[load]\nT_load_Nm = [[0, 0.01], [0.25, 0.02]]\n"
      "[[effect]]\nkind = \"cogging\"\norder = 6\namplitude_Nm = 0.1\nphase_rad = "
      "0.3333333333333333\n"
      "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.2\n",
      "drive.toml",
      {"reference.speed_rpm=1234.5", "rates.n=7", "estimator.ekf_sensorless.P0_diag=[1,2,3,4]"});
  const std::string once = complete(config);
  Config again = Config::parse(once, "resolved.toml");
  EXPECT_EQ(complete(again), once);
  const DriveConfig& d = again.drive();
  EXPECT_TRUE(d.reference.in_rpm);
  EXPECT_EQ(d.reference.speed_rpm.at(0), 1234.5);
  EXPECT_EQ(d.rates.n, 7);
  EXPECT_EQ(d.load.T_load_Nm.at(0.3), 0.02);
  ASSERT_EQ(d.effects.size(), 2u);
  EXPECT_EQ(d.effects[0].effect->kind(), "cogging");
  EXPECT_EQ(d.effects[0].effect->at({}).T_load, 0.1 * std::sin(0.3333333333333333));
  EXPECT_NE(once.find("[1.0, 2.0, 3.0, 4.0]"), std::string::npos);
}

// A process that does not read [safety] passes it on, sub-tables at their place.
TEST(Config, ResolvedTextKeepsTablesThatNobodyReadHere) {
  const Config config = Config::load(
      "dilys2021", {"safety.hold_ms=2", "safety.off_at.over_current=open", "plant.fault.at_s=1"});
  const Config again = Config::parse(config.resolved(), "resolved.toml");
  EXPECT_EQ(again.given_number("safety.hold_ms"), 2);
  EXPECT_EQ(again.given_number("plant.fault.at_s"), 1);
  EXPECT_TRUE(again.has_table("safety.off_at"));
  EXPECT_EQ(again.resolved(), config.resolved());
}

TEST(Config, ResolvedTextSurvivesANameWithQuotesAndBackslashes) {
  const Config config = parse("name = 'a \"quoted\" C:\\\\name'\n" + drive_text());
  const Config again = Config::parse(config.resolved(), "resolved.toml");
  EXPECT_EQ(again.drive().name, config.drive().name);
}

TEST(Config, ResolvedTextWritesEveryDoubleBackToTheSameBits) {
  for (const char* number : {"1e-3", "0.1", "3.0000000000000004e-05", "12345.678901234567"}) {
    const Config config = parse(drive_text(), {std::string("load.slew_Nm_s=") + number});
    const Config again = Config::parse(config.resolved(), "resolved.toml");
    EXPECT_EQ(again.drive().load.slew_Nm_s, config.drive().load.slew_Nm_s) << number;
    EXPECT_EQ(again.drive().load.slew_Nm_s, std::stod(number));
  }
}

TEST(Config, AFileOverItsPresetChangesItsKeysAndNoOther) {
  const DriveConfig base = test::drive_of("dilys2021");
  const Config config = parse("preset = \"dilys2021\"\n[machine]\nR_s_Ohm = 2.5\n[rates]\nn = 3\n");
  EXPECT_EQ(config.drive().machine.R_s, 2.5);
  EXPECT_EQ(config.drive().rates.n, 3);
  EXPECT_EQ(config.drive().machine.psi_f, base.machine.psi_f);
  EXPECT_EQ(config.drive().rates.f_s_Hz, base.rates.f_s_Hz);
}

TEST(Config, AFileMayGiveItsSpeedOrRateTheOtherWayThanItsPreset) {
  const Config rpm = parse("preset = \"dilys2021\"\n[reference]\nspeed_rpm = 600\n");
  EXPECT_NEAR(rpm.drive().reference_at(0).omega_m_ref, 62.831853, 1e-6);
  const Config f_b = parse("preset = \"dilys2021\"\n[rates]\nf_b_Hz = 500\n");
  EXPECT_EQ(f_b.drive().rates.n, 10);
}

TEST(Overrides, WinOverFileAndPreset) {
  const Config config =
      parse("preset = \"dilys2021\"\n[rates]\nn = 3\n", {"rates.n=8", "rates.n=9"});
  EXPECT_EQ(config.drive().rates.n, 9);
  EXPECT_EQ(config.where("rates.n"), "--set");
}

TEST(Overrides, TakeABareWordAsTextAndTomlAsToml) {
  Config config = parse(drive_text(), {"start=align_if", "controller.angle_source=\"truth\"",
                                       "bus.pin=false", "load.T_load_Nm=[[0, 0.5], [1, 0.25]]"});
  EXPECT_EQ(config.drive().start, Start::kAlignIf);
  EXPECT_EQ(config.drive().controller.angle_source, AngleSource::kTruth);
  EXPECT_FALSE(config.read<BusParameters>().pin);
  EXPECT_EQ(config.drive().load.T_load_Nm.at(1), 0.25);
}

TEST(Overrides, OneSpeedOrRateReplacesTheOther) {
  const Config rpm = parse(drive_text(), {"reference.speed_rpm=600"});
  EXPECT_NEAR(rpm.drive().reference_at(0).omega_m_ref, kTwoPi * 10, 1e-12);
  EXPECT_EQ(parse(drive_text(), {"rates.f_b_Hz=500"}).drive().rates.n, 10);
}

// Contradicting overrides are refused in either order.
TEST(Overrides, ThatContradictEachOtherAreRefusedAndBothAreNamed) {
  const auto refusal = [](const std::vector<std::string>& overrides) -> std::string {
    try {
      parse(drive_text(), overrides);
    } catch (const BadInput& error) {
      return error.what();
    }
    return "";
  };
  const std::string rates = "--set: rates.f_b_Hz: gives n = 10, but rates.n = 2 is given too";
  EXPECT_EQ(refusal({"rates.f_b_Hz=500", "rates.n=2"}), rates);
  EXPECT_EQ(refusal({"rates.n=2", "rates.f_b_Hz=500"}), rates);
  EXPECT_EQ(refusal({"rates.n=10", "rates.f_b_Hz=500"}), "");
  EXPECT_EQ(refusal({"rates.f_b_Hz=0", "rates.n=2"}), "");  // 0: not given
  const std::string speeds =
      "--set: reference.speed_rpm: give either speed_rpm or omega_e_rad_s, not both";
  EXPECT_EQ(refusal({"reference.speed_rpm=600", "reference.omega_e_rad_s=40"}), speeds);
  EXPECT_EQ(refusal({"reference.omega_e_rad_s=40", "reference.speed_rpm=600"}), speeds);
}

TEST(Rates, ABackgroundRateWithinTheRoundingOfAWholeRatioIsTaken) {
  EXPECT_EQ(parse(drive_text(), {"rates.f_b_Hz=416.7"}).drive().rates.n, 12);
  EXPECT_NEAR(parse(drive_text(), {"rates.f_b_Hz=416.7"}).drive().rates.f_b_Hz, 5000.0 / 12, 1e-9);
}

TEST(Profiles, ANumberIsAConstantAndPairsAreSteps) {
  const DriveConfig constant = parse(drive_text(), {"reference.omega_e_rad_s=40"}).drive();
  EXPECT_TRUE(constant.reference.omega_e_rad_s.is_constant());
  const DriveConfig steps =
      parse(drive_text(), {"reference.omega_e_rad_s=[[0, 40], [0.5, -80], [1, 0]]"}).drive();
  EXPECT_NEAR(steps.reference_at(0).omega_m_ref, 10, 1e-12);
  EXPECT_NEAR(steps.reference_at(2499).omega_m_ref, 10, 1e-12);
  EXPECT_NEAR(steps.reference_at(2500).omega_m_ref, -20, 1e-12);
  EXPECT_NEAR(steps.reference_at(5000).omega_m_ref, 0, 1e-12);
}

TEST(Profiles, AConstantThatBeginsLaterIsStillThatProfileInTheResolvedText) {
  const Config config = parse(drive_text(), {"load.T_load_Nm=[[0.5, 0.02]]"});
  const Config again = Config::parse(config.resolved(), "resolved.toml");
  for (double t : {0.0, 1.0})
    EXPECT_EQ(again.drive().load.T_load_Nm.at(t), config.drive().load.T_load_Nm.at(t));
}

TEST(DescribeKeys, NamesEveryKeyOnce) {
  for (const char* kind : {"ekf_sensorless", "ekf_disturbance"}) {
    const auto builder = filter_builder(kind);
    std::set<std::string> keys;
    for (const KeyRow& row : describe_keys(kind, [&](FieldVisitor& f) { builder->fields(f); }))
      EXPECT_TRUE(keys.insert(row.key).second) << row.key;
  }
  const auto foc = controller_builder("foc");
  std::set<std::string> keys;
  for (const KeyRow& row :
       describe_keys("controller.foc", [&](FieldVisitor& f) { foc->fields(f); })) {
    EXPECT_TRUE(keys.insert(row.key).second) << row.key;
    EXPECT_FALSE(row.meaning.empty());
  }
  EXPECT_EQ(keys.count("controller.foc.startup.t_align_s"), 1u);
  keys.clear();
  for (const KeyRow& row : describe_drive_keys(owned_tables()))
    EXPECT_TRUE(keys.insert(row.key).second) << row.key;
}

const std::string kLateCogging =
    "[[effect]]\nkind = \"cogging\"\norder = 24\namplitude_Nm = 0.01\nfrom_s = 1.5\n";

TEST(Effects, StartAtTheTimeInTheFile) {
  const Config config = parse(drive_text() + kLateCogging);
  ASSERT_EQ(config.drive().effects.size(), 1u);
  EXPECT_EQ(config.drive().effects[0].from_s, 1.5);
  const Config again = parse(config.resolved());
  EXPECT_EQ(again.drive().effects[0].from_s, 1.5);
  const Effects plant = config.drive().plant_effects();
  OperatingPoint point{.t = 1.4999, .theta_m = 0.03};
  EXPECT_EQ(plant[0]->at(point).T_load, 0);
  point.t = 1.5;
  EXPECT_DOUBLE_EQ(plant[0]->at(point).T_load, 0.01 * std::sin(24 * 0.03));
}

TEST(Effects, WithoutAStartTimeAreNotWrapped) {
  const Config config =
      parse(drive_text() + "[[effect]]\nkind = \"constant_load\"\ntorque_Nm = 0.1\n");
  EXPECT_EQ(config.drive().plant_effects()[0], config.drive().effects[0].effect);
}

TEST(Effects, CanBeAddedToAConfig) {
  const Config config = parse(drive_text());
  const Config more = config.with_effects(
      "[[effect]]\nkind = \"resistance\"\nused_in = \"model\"\nchange_Ohm = 0.2\n", "request");
  EXPECT_EQ(more.drive().model_effects().size(), 1u);
  EXPECT_EQ(more.drive().plant_effects().size(), 0u);
  EXPECT_EQ(more.drive().machine.R_s, config.drive().machine.R_s);
}

// Before its only step steering.n is rates.n: the step keeps its time in what is written.
TEST(Resolved, TheOnlyStepOfAProfileKeepsItsTime) {
  Config config =
      Config::load("dilys2021", {"steering.n=[[0.4,8]]", "steering.emergency=[[0.6,\"stop\"]]"});
  Config again = Config::parse(config.resolved(), "resolved");
  const SteeringParameters steering = steering_of(again);
  const auto stops = planned_emergencies(again.drive(), steering);
  ASSERT_EQ(stops.size(), 1u);
  EXPECT_EQ(stops[0].k, 3000);
  const RateHistory rates = rate_history(again);
  ASSERT_EQ(rates.changes().size(), 1u);
  EXPECT_EQ(rates.changes()[0].k, 2000);
}

}  // namespace
}  // namespace twinrate
