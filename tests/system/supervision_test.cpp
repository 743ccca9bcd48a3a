// A process that ends or stops answering ends the set, with its name and the reason; no process is
// left.
#include <csignal>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class Supervision : public SetTest {
 protected:
  // A run of several minutes; returns once its log grows.
  std::unique_ptr<Program> start_long_run(std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"twinrate", "launch", "dilys2021", "--run-dir", path("run"),
                               "--duration", "600s"});
    auto launch = std::make_unique<Program>(more);
    const bool running = wait_until([&] { return log_size() > 200'000; }, 20);
    EXPECT_TRUE(running) << launch->err();
    return launch;
  }
  // The log is whole up to a tick, and the summary reports the early end. Only a logger that was
  // killed may leave a last record that is cut off.
  RunLog expect_readable_log(OnDamage on_damage = OnDamage::kRefuse) {
    RunLog log = read_run_log(path("run"), "", on_damage);
    EXPECT_GT(log.measurement.size(), 100u);
    for (std::size_t i = 0; i < log.command.size(); ++i)
      EXPECT_EQ(log.command[i].k, static_cast<std::int64_t>(i));
    return log;
  }
  nlohmann::json json(const char* file) const {
    return nlohmann::json::parse(read_text(path("run") + "/" + file), nullptr, false);
  }
};

class DeadChild : public Supervision, public ::testing::WithParamInterface<const char*> {};

TEST_P(DeadChild, EndsTheSetWithItsNameAndSignal) {
  const std::string program = GetParam();
  const auto launch = start_long_run();
  kill(child(program), SIGKILL);
  const ProgramResult result = launch->wait(8);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find(program + " ended with signal 9"), std::string::npos) << result.err;
  EXPECT_NE(result.out.find("ended early"), std::string::npos) << result.out;
  expect_nothing_left();
  expect_readable_log(program == "twinrate-logger" ? OnDamage::kSkip : OnDamage::kRefuse);
  EXPECT_LT(json("summary.json")["duration_s"], 600.0);
  EXPECT_NE(json("manifest.json")["ended_early"].get<std::string>().find(program),
            std::string::npos);
  const bool counted = program != "twinrate-logger";
  EXPECT_EQ(result.out.find("the logger ended before its count") == std::string::npos, counted)
      << result.out;
  EXPECT_EQ(json("summary.json")["losses_counted"], counted);
}

INSTANTIATE_TEST_SUITE_P(System, DeadChild,
                         ::testing::Values("twinrate-plant", "twinrate-estimator", "twinrate-gain",
                                           "twinrate-controller", "twinrate-logger"),
                         [](const auto& child) {
                           return std::string(child.param).substr(sizeof "twinrate-" - 1);
                         });

class SilentChild : public Supervision, public ::testing::WithParamInterface<const char*> {};

TEST_P(SilentChild, IsNamedByTheOneThatWaitsForIt) {
  const std::string program = GetParam(), role = program.substr(sizeof "twinrate-" - 1);
  const auto launch = start_long_run({"--set", "bus.peer_timeout_s=1"});
  kill(child(program), SIGSTOP);
  const ProgramResult result = launch->wait(15);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find(role + " stopped answering"), std::string::npos) << result.err;
  EXPECT_LT(result.wall_s, 12);
  expect_nothing_left();
  bool said = false;
  const auto on_damage = role == "logger" ? OnDamage::kSkip : OnDamage::kRefuse;
  for (const EventRecord& event : expect_readable_log(on_damage).events)
    said = said || (event.reason == static_cast<int>(Reason::kPeerTimeout) &&
                    event.text.find("from " + role) != std::string::npos &&
                    role_name(event.waited_for) == role);
  EXPECT_TRUE(said || program == "twinrate-logger");
}

INSTANTIATE_TEST_SUITE_P(System, SilentChild,
                         ::testing::Values("twinrate-plant", "twinrate-estimator", "twinrate-gain",
                                           "twinrate-controller", "twinrate-logger"),
                         [](const auto& child) {
                           return std::string(child.param).substr(sizeof "twinrate-" - 1);
                         });

TEST_F(Supervision, CtrlCEndsTheRunCleanly) {
  const auto launch = start_long_run();
  launch->signal_group(SIGINT);
  const ProgramResult result = launch->wait(8);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.out.find("ended early"), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("interrupted"), std::string::npos) << result.out;
  expect_nothing_left(0);
  const RunLog log = expect_readable_log();
  EXPECT_EQ(log.events.back().reason, static_cast<int>(Reason::kStopRequested));
  for (const char* file : {"summary.json", "manifest.json", "report.html", "config.toml"})
    EXPECT_TRUE(std::filesystem::exists(path("run") + "/" + file)) << file;
  EXPECT_EQ(json("summary.json")["steps"], log.measurement.size());
  for (const auto& [channel, lost] : json("summary.json")["lost_messages"].items())
    EXPECT_EQ(lost, 0) << channel;
}

TEST_F(Supervision, KilledSupervisorTakesItsChildrenAlong) {
  const auto launch = start_long_run();
  ASSERT_EQ(processes_with(path("run")).size(), 6u);
  launch->signal(SIGKILL);
  expect_nothing_left(2);
  expect_readable_log();
}

// Lock-step: nobody need wait for the supervisor, and nobody for a plant that has done its run.
TEST_F(Supervision, AFrozenSupervisorDoesNotMakeAWholeRunAFailure) {
  Program launch({"twinrate", "launch", "dilys2021", "--run-dir", path("run"), "--duration", "3s",
                  "--set", "bus.peer_timeout_s=0.3"});
  const auto plants = [&] { return processes_with(path("run"), "twinrate-plant").size(); };
  ASSERT_TRUE(wait_until([&] {
    return plants() > 0 && std::filesystem::exists(path("run") + "/log.lcm") &&
           std::filesystem::file_size(path("run") + "/log.lcm") > 100'000;
  }));
  launch.signal(SIGSTOP);
  ASSERT_TRUE(wait_until([&] { return plants() == 0; }));
  usleep(2'000'000);  // longer than the most patient one
  launch.signal(SIGCONT);
  const ProgramResult result = launch.wait(10);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("LOCKED"), std::string::npos) << result.out;
}

TEST_F(Supervision, AStoppedPlantIsAnEarlyEnd) {
  const auto launch = start_long_run();
  kill(child("twinrate-plant"), SIGTERM);
  const ProgramResult result = launch->wait(8);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.out.find("stopped at tick"), std::string::npos) << result.out;
  expect_nothing_left();
}

TEST_F(Supervision, AChildThatNeverGetsReadyIsNamedAndLeavesNoSecondMessage) {
  // Killed before the first tick: the log has no tick.
  Program launch(
      {"twinrate", "launch", "dilys2021", "--run-dir", path("run"), "--duration", "600s"});
  ASSERT_TRUE(wait_until([&] { return !processes_with(path("run"), "twinrate-gain").empty(); }));
  kill(processes_with(path("run"), "twinrate-gain").front(), SIGKILL);
  const ProgramResult result = launch.wait(10);
  EXPECT_EQ(result.exit_code, 1) << result.err;
  EXPECT_EQ(count_lines(result.err), 1) << result.err;
  EXPECT_NE(result.err.find("twinrate-gain ended with signal 9"), std::string::npos) << result.err;
  expect_nothing_left();
}

TEST_F(Supervision, SimulateStopsCleanlyToo) {
  Program simulate(
      {"twinrate", "simulate", "dilys2021", "--run-dir", path("run"), "--duration", "3000s"});
  ASSERT_TRUE(wait_until([&] { return log_size() > 1'000'000; }));
  simulate.signal_group(SIGINT);
  const ProgramResult result = simulate.wait(60);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.out.find("interrupted"), std::string::npos) << result.out;
  expect_readable_log();
}

}  // namespace
}  // namespace twinrate::test
