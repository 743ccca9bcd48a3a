// The reference runs of docs/theory/two-rate-ekf.md with `twinrate launch`, and their files.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "core/run_log.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

using Json = nlohmann::json;

class NominalRun : public ProgramTest {
 protected:
  ProgramResult launch(int n, const char* duration) {
    return twinrate({"launch", "dilys2021", "--run-dir", path("run"), "--duration", duration,
                     "--set", "rates.n=" + std::to_string(n)});
  }
  // Without the trip by over-current, as the paper's drive.
  ProgramResult launch_untripped(int n, const char* duration) {
    return twinrate({"launch", "dilys2021", "--run-dir", path("run"), "--duration", duration,
                     "--set", "rates.n=" + std::to_string(n), "--set", "machine.i_trip_A=1000",
                     "--set", "safety.watch_sensors=false"});
  }
  Json json(const char* file) const { return Json::parse(read_text(path("run") + "/" + file)); }
};

TEST_F(NominalRun, FiveStepsABackgroundUpdateKeepSynchronism) {
  const ProgramResult result = launch(5, "2s");
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("LOCKED"), std::string::npos) << result.out;
  for (const char* file :
       {"log.lcm", "config.toml", "manifest.json", "summary.json", "report.html"})
    EXPECT_GT(std::filesystem::file_size(path("run") + "/" + file), 100u) << file;

  const Json summary = json("summary.json");
  EXPECT_EQ(summary["locked"], true);
  EXPECT_DOUBLE_EQ(summary["duration_s"], 2);
  EXPECT_EQ(summary["steps"], 10000);
  const double angle_rms = summary["angle_error_rms_rad"],
               angle_max = summary["angle_error_max_rad"];
  EXPECT_GT(angle_rms, 0.03);
  EXPECT_LT(angle_rms, 0.06);
  EXPECT_GT(angle_max, angle_rms);
  EXPECT_LT(angle_max, 0.1);
  EXPECT_GT(summary["speed_error_rms_rad_s"], 0.01);
  EXPECT_LT(summary["speed_error_rms_rad_s"], 1.0);
  EXPECT_GT(summary["speed_ripple_rms_rad_s"], 0.0);
  EXPECT_LE(summary["speed_ripple_harmonics_rms_rad_s"], summary["speed_ripple_rms_rad_s"]);
  EXPECT_EQ(summary["lost_messages"].size(), 11u);
  for (const auto& [channel, lost] : summary["lost_messages"].items())
    EXPECT_EQ(lost, 0) << channel;
  EXPECT_GE(summary["repeats"], 0);
  EXPECT_EQ(summary["deadline_misses"], 0);
  EXPECT_EQ(summary["late_gains"], 0);
  EXPECT_GT(summary["wall_s"], 0.05);
  EXPECT_GT(summary["steps_per_s"], 100);
  EXPECT_EQ(summary["f_s_Hz"], 5000.0);
  EXPECT_EQ(summary["f_b_Hz"], 1000.0);

  const Json manifest = json("manifest.json");
  EXPECT_EQ(manifest["seed"], 1);
  for (const char* key : {"revision", "host", "versions"})
    EXPECT_TRUE(manifest.contains(key)) << key;
  EXPECT_EQ(manifest["log"]["channels"]["DRIVE_MEASUREMENT"]["received"], 10000);
  EXPECT_EQ(manifest["log"]["channels"]["DRIVE_GAIN"]["received"], 2000);
  EXPECT_EQ(twinrate({"check", path("run") + "/config.toml"}).exit_code, 0);
}

TEST_F(NominalRun, TwelveStepsKeepSynchronism) {
  EXPECT_EQ(launch(12, "1s").exit_code, 0);
  EXPECT_EQ(json("summary.json")["locked"], true);
}

TEST_F(NominalRun, ThirteenStepsLoseSynchronismAndTheMotorReverses) {
  const ProgramResult result = launch_untripped(13, "2s");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.out.find("LOST"), std::string::npos) << result.out;
  EXPECT_EQ(json("summary.json")["locked"], false);
  const RunLog log = read_run_log(path("run"));
  const auto slowest =
      std::min_element(log.truth.begin(), log.truth.end(),
                       [](const Truth& a, const Truth& b) { return a.omega_m < b.omega_m; });
  EXPECT_LT(slowest->omega_m, -50);
}

TEST_F(NominalRun, ADriveThatLostSynchronismSwitchesOffAtItsTripCurrent) {
  const ProgramResult result = launch(13, "1s");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.out.find("TRIPPED"), std::string::npos) << result.out;
  const Json summary = json("summary.json");
  EXPECT_EQ(summary["locked"], false);
  EXPECT_EQ(summary["trip"]["name"], "over_current");
  EXPECT_EQ(summary["trip"]["process"], "plant");
}

TEST_F(NominalRun, ProgressComesAsJsonLines) {
  const ProgramResult result =
      twinrate({"launch", "dilys2021", "--run-dir", path("run"), "--duration", "2s", "--json"});
  EXPECT_EQ(result.exit_code, 0);
  std::istringstream lines(result.out);
  int progress_lines = 0;
  for (std::string line; std::getline(lines, line);)
    if (line.rfind("{\"t_s\"", 0) == 0) {
      ++progress_lines;
      EXPECT_TRUE(Json::parse(line, nullptr, false).contains("steps_per_s")) << line;
    }
  EXPECT_GE(progress_lines, 1);
}

// At 3 kHz the bandwidths of this machine do not hold n = 8: others are named.
TEST(DesignForN, PrintsTheWeightsOfTheBandwidthsThatItNames) {
  const std::vector<std::string> design = {"design", "lqr", "dilys2021", "--set",
                                           "rates.f_s_Hz=3000"};
  const auto run = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = design;
    arguments.insert(arguments.end(), more.begin(), more.end());
    const ProgramResult result = twinrate(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.err;
    return result.out;
  };
  const std::string text = run({"--for-n", "8"});
  double current = 0, speed = 0, integral = 0, Q_current = 0, Q_integral = 0;
  const auto of = text.find("of bandwidths"), Q = text.find("Q_d = [");
  ASSERT_NE(of, std::string::npos) << text;
  ASSERT_NE(Q, std::string::npos) << text;
  ASSERT_EQ(
      std::sscanf(text.c_str() + of, "of bandwidths current %lf Hz, speed %lf Hz, integral %lf Hz",
                  &current, &speed, &integral),
      3);
  ASSERT_EQ(std::sscanf(text.c_str() + Q, "Q_d = [%lf, %lf]", &Q_current, &Q_integral), 2);
  const auto list = [](auto... Hz) {
    std::string joined;
    ((joined += (joined.empty() ? "" : ", ") + std::to_string(Hz)), ...);
    return "[" + joined + "]";
  };
  const Json named = Json::parse(
      run({"--set", "controller.kind=lqr", "--set", "controller.lqr.gains=bandwidths", "--set",
           "controller.lqr.bandwidth_d_Hz=" + list(current, integral), "--set",
           "controller.lqr.bandwidth_q_Hz=" + list(current, speed, integral), "--json"}));
  // The bandwidths are printed with four digits.
  EXPECT_NEAR(Q_current / named["d"]["Q"][0].get<double>(), 1, 2e-3);
  EXPECT_NEAR(Q_integral / named["d"]["Q"][1].get<double>(), 1, 2e-3);
}

TEST_F(NominalRun, CheckPrintsTheWindowOfTheFigures) {
  const std::vector<std::string> sets = {"--set", "start=\"align_if\"", "--set",
                                         "run.duration_s=2"};
  const auto with_sets = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), sets.begin(), sets.end());
    return twinrate(arguments).out;
  };
  const std::string printed = with_sets({"check", "kim-ipmsm"}),
                    ran = with_sets({"simulate", "kim-ipmsm", "--run-dir", path("run")});
  // settle_s = 0.3 is before the hand-over.
  const std::string before = "figures from the hand-over on (about ", after = "figures from ";
  ASSERT_NE(printed.find(before), std::string::npos) << printed;
  const double expected = std::stod(printed.substr(printed.find(before) + before.size())),
               used = std::stod(ran.substr(ran.find(after) + after.size()));
  EXPECT_NEAR(used, expected, 0.1);
}

}  // namespace
}  // namespace twinrate::test
