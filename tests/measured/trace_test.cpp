// Traces of recorded machines with the program. The data are not in the repository:
// TWINRATE_MEASURED, else ../shared/measured; without them a test is skipped with a message.
// tools/measured-report prints the results as tables.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "core/config.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::string measured(const std::string& file) {
  const char* given = std::getenv("TWINRATE_MEASURED");
  return (given && *given ? given : std::string(TWINRATE_SOURCE_DIR) + "/../shared/measured") +
         "/" + file;
}

std::string map_option(const std::string& name) {
  return " --map " + std::string(TWINRATE_SOURCE_DIR) + "/tools/maps/" + name + ".toml";
}

struct Traced {
  json trace;
  std::string extended;
};

Traced trace(const std::string& arguments) {
  const fs::path out = fs::temp_directory_path() / fmt::format("twinrate-measured-{}", getpid());
  const std::string command =
      fmt::format("{} trace {} --out {} >/dev/null", TWINRATE_PROGRAM, arguments, out.string());
  EXPECT_EQ(std::system(command.c_str()), 0) << command;
  Traced traced;
  std::ifstream file(out / "trace.json");
  traced.trace = json::parse(file);
  std::ifstream extended(out / "extended.toml");
  traced.extended.assign(std::istreambuf_iterator<char>(extended), {});
  // It loads, as every program loads it.
  Config config = Config::parse(traced.extended, "extended.toml");
  read_all_tables(config);
  config.require_all_read();
  fs::remove_all(out);
  return traced;
}

std::set<std::string> kinds(const json& trace) {
  std::set<std::string> all;
  for (const json& e : trace["effects"]) all.insert(e["kind"]);
  return all;
}

const json* effect(const json& trace, const std::string& kind) {
  for (const json& e : trace["effects"])
    if (e["kind"] == kind) return &e;
  return nullptr;
}

double value(const json& effect, const char* parameter) {
  return effect["parameters"][parameter]["value"];
}

// The rows of a CSV whose last column is `last`, with its header.
void rows_with(const std::string& from, const std::string& last, const fs::path& to) {
  std::ifstream in(from);
  std::ofstream out(to);
  std::string line;
  for (bool first = true; std::getline(in, line); first = false)
    if (first || line.substr(line.rfind(',') + 1).find(last) != std::string::npos)
      out << line << "\n";
}

#define SKIP_WITHOUT(path) \
  if (!fs::exists(path))   \
  GTEST_SKIP() << path << " is not on this machine: set TWINRATE_MEASURED to the measured data"

class Laas : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (!fs::exists(measured("laas_cogging"))) return;
    const std::string directory = measured("laas_cogging/");
    const fs::path halves = fs::temp_directory_path() / fmt::format("twinrate-halves-{}", getpid());
    fs::create_directories(halves);
    for (const char* on : {"0", "1"})
      rows_with(directory + "speed_test_old.csv", on, halves / (std::string(on) + ".csv"));
    traced_ = new Traced(trace(fmt::format(
        "laas_mn4004 --data {0}stopped_data.csv {0}acc_current.csv --holdout {1}/0.csv "
        "{1}/1.csv{2}{3}",
        directory, halves.string(), map_option("laas_bench"), map_option("laas_speed_test"))));
    fs::remove_all(halves);
  }
  static void TearDownTestSuite() {
    delete traced_;
    traced_ = nullptr;
  }
  void SetUp() override { SKIP_WITHOUT(measured("laas_cogging")); }
  static Traced* traced_;
};
Traced* Laas::traced_ = nullptr;

TEST_F(Laas, NamesCoggingFrictionAndTheLateSpeed) {
  const json& t = traced_->trace;
  EXPECT_EQ(t["verdict"], "traced");
  EXPECT_EQ(t["effects"][0]["kind"], "cogging");
  EXPECT_EQ(value(t["effects"][0], "order"), 72);
  EXPECT_NEAR(value(t["effects"][0], "amplitude"), 5.1e-3, 0.2e-3);
  EXPECT_EQ(kinds(t), (std::set<std::string>{"cogging", "coulomb_friction", "signal_lag"}));
  EXPECT_NEAR(value(*effect(t, "coulomb_friction"), "torque"), 1.5e-3, 0.2e-3);
  EXPECT_EQ((*effect(t, "signal_lag"))["parameters"]["signal"]["value"], "speed");
  EXPECT_NEAR(value(*effect(t, "signal_lag"), "lag"), 1.9e-3, 0.25e-3);
}

TEST_F(Laas, FindsTheResistanceThatALateSpeedHides) {
  const json& R = traced_->trace["constants"]["R_s"];
  EXPECT_GT(double(R["value"]), 0.46);
  EXPECT_LT(double(R["value"]), 0.56);
}

TEST_F(Laas, NamesNoEffectForTheRippleOfTheVoltage) {
  const json& ambiguous = traced_->trace["ambiguous"];
  EXPECT_TRUE(std::any_of(ambiguous.begin(), ambiguous.end(), [](const json& a) {
    const std::string why = a["why"];
    return a["kinds"] == json({"inverter_offset", "current_offset"}) &&
           why.find("12 times a turn") != std::string::npos;
  }));
}

TEST_F(Laas, PredictsASpeedThatWasNotFitted) {
  const json& error = traced_->trace["error"];
  EXPECT_NEAR(double(error["horizon_s"]), 5e-3, 1e-6);
  int unseen = 0;
  for (const json& file : error["files"]) {
    if (file["role"] != "holdout") continue;
    ++unseen;
    EXPECT_LT(double(file["after"]), 0.25 * double(file["no_change"])) << file["file"];
    EXPECT_GT(double(file["before"]), double(file["no_change"])) << "i_q and friction alone";
  }
  EXPECT_EQ(unseen, 2);
}

TEST(OdriveSlowRuns, AreExplainedByTheMapOfAnotherDayBehindAFilter) {
  const std::string directory = measured("gchen_odrive/");
  SKIP_WITHOUT(directory);
  const Traced traced = trace(
      fmt::format("odrive_150kv --data {0}coggingmap_a_4.csv {0}slow2_slower__comp_0.csv --holdout "
                  "{0}slow2__comp_1.csv {0}slow2__nocomp_1.csv{1}{2}",
                  directory, map_option("odrive_cogging_map"), map_option("odrive_slow_run")));
  const json& t = traced.trace;
  ASSERT_NE(effect(t, "signal_lag"), nullptr);
  EXPECT_EQ((*effect(t, "signal_lag"))["parameters"]["signal"]["value"], "current");
  EXPECT_NEAR(value(*effect(t, "signal_lag"), "lag"), 0.11, 0.02);
  EXPECT_EQ(t["error"]["unit"], "A");
  EXPECT_LT(double(t["error"]["after"]["holdout"]), double(t["error"]["before"]["holdout"]) / 10);
  EXPECT_EQ(effect(t, "coulomb_friction"), nullptr) << "every run goes the same way";
}

TEST(InverterCurve, IsTwentyTimesBetterExplainedThanByResistance) {
  const std::string file = measured("inverter_iv_pangu/phaseB_80V_294pts.csv");
  SKIP_WITHOUT(file);
  const Traced traced = trace("pangu_80v --data " + file + map_option("inverter_curve_b"));
  const json& t = traced.trace;
  ASSERT_NE(effect(t, "inverter_drop"), nullptr);
  EXPECT_EQ((*effect(t, "inverter_drop"))["aliases"], json({"dead_time"}));
  EXPECT_LT(double(t["error"]["after"]["holdout"]), double(t["error"]["before"]["holdout"]) / 20);
}

TEST(FluxMap, SaturationAndCrossSaturationLeaveAnEighthOrLess) {
  const std::string file = measured("motulator_flux_map/baldor_400rpm_map.csv");
  SKIP_WITHOUT(file);
  const Traced traced = trace("baldor_ecs101 --data " + file + map_option("flux_map"));
  const json& t = traced.trace;
  EXPECT_NE(effect(t, "saturation"), nullptr);
  EXPECT_NE(effect(t, "cross_saturation"), nullptr);
  EXPECT_LT(double(t["error"]["after"]["holdout"]), double(t["error"]["before"]["holdout"]) / 8);
}

}  // namespace
}  // namespace twinrate
