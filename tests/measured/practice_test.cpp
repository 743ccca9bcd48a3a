// Practice logs of an independent generator with known effects. Skipped if they are not on this
// machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "drive_log/drive_logs.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

std::string practice_directory() {
  if (const char* given = std::getenv("TWINRATE_PRACTICE")) return given;
  return std::string(TWINRATE_SOURCE_DIR) + "/../shared/practice";
}

std::vector<std::string> true_kinds(const std::string& path) {
  static const std::map<std::string, std::string> kNames = {{"coulomb", "coulomb_friction"},
                                                            {"cogging", "cogging"},
                                                            {"dead_time", "dead_time"},
                                                            {"Rs_drift", "resistance"},
                                                            {"cur_offset", "current_offset"},
                                                            {"cur_gain", "current_gain"},
                                                            {"psi_drop", "flux_linkage"},
                                                            {"Lq_sat", "saturation"},
                                                            {"enc_ecc", "encoder_eccentricity"},
                                                            {"twomass", "torsion"},
                                                            {"skew_u", "signal_lag"},
                                                            {"x_vibration", "outside"}};
  std::ifstream file(path);
  std::vector<std::string> kinds;
  const auto truth = nlohmann::json::parse(file);
  for (const auto& effect : truth["effects"]) kinds.push_back(kNames.at(effect["name"]));
  std::sort(kinds.begin(), kinds.end());
  return kinds;
}

class Practice : public testing::TestWithParam<int> {};

TEST_P(Practice, TheMissingEffectsAreFound) {
  const std::string stem =
      practice_directory() + "/p" + (GetParam() < 10 ? "0" : "") + std::to_string(GetParam());
  if (!fs::exists(stem + ".csv.gz"))
    GTEST_SKIP() << "no practice logs at " << practice_directory() << " (TWINRATE_PRACTICE)";
  const Config config = Config::parse(Config::load("niewiara2020").resolved_with({}), "declared",
                                      {"machine.B_Nms=0.002"});
  const DriveLogs logs = read_drive_logs({.data = {stem + ".csv.gz"}}, config.drive());
  const TraceResult r = trace_record(logs.record, config.drive(), logs.health, {});
  std::vector<std::string> found;
  for (const TracedEffect& e : r.effects) found.emplace_back(e.effect->kind());
  if (r.structured) found.emplace_back("outside");
  std::sort(found.begin(), found.end());
  EXPECT_EQ(found, true_kinds(stem + ".truth.json")) << r.sentence;
}

INSTANTIATE_TEST_SUITE_P(Logs, Practice, testing::Range(1, 16));

}  // namespace
}  // namespace twinrate
