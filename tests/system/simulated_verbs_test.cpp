// The program of TWINRATE_VERBS=SIMULATED: it lists every verb, runs a simulated drive, and refuses what it lacks.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>
#include <vector>

#include "tests/system/run_program.hpp"

namespace twinrate::simulated_verbs_test {
namespace {

using Json = nlohmann::json;

class SimulatedVerbs : public test::ProgramTest {
 protected:
  static test::ProgramResult run(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), TWINRATE_SIMULATED_PROGRAM);
    return test::run_program(arguments);
  }
  static std::string verbs_of(const test::ProgramResult& help) {
    return help.out.substr(std::min(help.out.find("Subcommands:"), help.out.size()));
  }
  static void expect_refused(const std::vector<std::string>& arguments, const std::string& what) {
    const test::ProgramResult result = run(arguments);
    EXPECT_EQ(result.exit_code, 3) << what;
    EXPECT_EQ(test::count_lines(result.err), 1) << result.err;
    EXPECT_TRUE(result.err.starts_with("twinrate: " + what + ": not in this build")) << result.err;
    EXPECT_NE(result.err.find("/tools/build-all"), std::string::npos) << result.err;
  }
};

TEST_F(SimulatedVerbs, AreListedAsThoseOfTheWholeProgram) {
  const std::string all = verbs_of(test::twinrate({"--help"}));
  EXPECT_GT(test::count_lines(all), 20);
  EXPECT_EQ(verbs_of(run({"--help"})), all);
}

TEST_F(SimulatedVerbs, EachOtherVerbIsRefusedWithTheCommandThatBuildsIt) {
  const std::string help = verbs_of(run({"--help"}));
  const std::regex line("\n  (\\w+) ");
  int refused = 0;
  for (std::sregex_iterator verb(help.begin(), help.end(), line), end; verb != end; ++verb) {
    const std::string name = (*verb)[1];
    if (run({name, "--help"}).exit_code == 0) continue;
    expect_refused({name, "--help"}, name);
    expect_refused({name, "fb", "dilys2021", "--out", path("out")}, name);
    ++refused;
  }
  EXPECT_EQ(refused, 17);
}

TEST_F(SimulatedVerbs, LaunchAndSimulateRunADrive) {
  const auto locked = [this](const std::string& directory) {
    return Json::parse(test::read_text(path(directory) + "/summary.json"))["locked"] == true &&
           std::filesystem::exists(path(directory) + "/report.html");
  };
  const test::ProgramResult launched =
      run({"launch", "dilys2021", "--duration", "300ms", "--run-dir", path("launched")});
  EXPECT_EQ(launched.exit_code, 0) << launched.err;
  EXPECT_TRUE(locked("launched"));
  const test::ProgramResult simulated =
      run({"simulate", "dilys2021", "--duration", "300ms", "--run-dir", path("simulated")});
  EXPECT_EQ(simulated.exit_code, 0) << simulated.err;
  EXPECT_TRUE(locked("simulated"));
}

TEST_F(SimulatedVerbs, TheMonitorOfASimulationIsRefusedBeforeTheRun) {
  expect_refused({"simulate", "dilys2021", "--monitor", "--run-dir", path("run")},
                 "monitor.enabled");
  EXPECT_FALSE(std::filesystem::exists(path("run")));
}

}  // namespace
}  // namespace twinrate::simulated_verbs_test
