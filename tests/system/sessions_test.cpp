// Several drives, sessions and configs on one bus.
#include <csignal>
#include <filesystem>
#include <lcm/lcm-cpp.hpp>
#include <regex>
#include <string>

#include "core/channels.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test::sessions_test {
namespace {

constexpr const char* kDuration = "0.4s";
constexpr int kTicks = 2000;

class Sessions : public ProgramTest {
 protected:
  std::vector<std::string> launch(const std::string& run, const std::string& seed,
                                  std::vector<std::string> more = {}) {
    more.insert(more.begin(), {"twinrate", "launch", "dilys2021", "--run-dir", path(run),
                               "--duration", kDuration, "--set", "run.seed=" + seed});
    return more;
  }
  void expect_as_simulated(const std::string& run, const std::string& seed) {
    const std::string simulated = path("simulated-" + seed);
    ASSERT_EQ(twinrate({"simulate", "dilys2021", "--run-dir", simulated, "--duration", kDuration,
                        "--set", "run.seed=" + seed})
                  .exit_code,
              0);
    EXPECT_TRUE(same_messages(path(run), simulated, kTicks));
  }
  // The largest count of refused messages among the processes of the run.
  std::int64_t refused(const std::string& run) {
    std::int64_t most = 0;
    lcm::LogFile file(path(run) + "/log.lcm", "r");
    while (const lcm::LogEvent* event = file.readNextEvent()) {
      status_t status{};
      if (event->channel == info(Channel::kStatus).name &&
          status.decode(event->data, 0, event->datalen) >= 0)
        most = std::max(most, status.refused);
    }
    return most;
  }
};

TEST_F(Sessions, TwoDrivesSideBySideDoNotDisturbEachOther) {
  Program a(launch("a", "1", {"--channel-suffix", "_A"}));
  Program b(launch("b", "2", {"--channel-suffix", "_B"}));
  EXPECT_EQ(a.wait(60).exit_code, 0);
  EXPECT_EQ(b.wait(60).exit_code, 0);
  expect_as_simulated("a", "1");
  expect_as_simulated("b", "2");
  EXPECT_EQ(read_run_log(path("a")).channel_suffix, "_A");
  EXPECT_EQ(twinrate({"replay", path("b"), "--lockstep"}).exit_code, 0)
      << "a log with a suffix is replayed too";
}

TEST_F(Sessions, TwoSessionsOnTheSameChannelsRefuseEachOther) {
  Program a(launch("a", "1")), b(launch("b", "2"));
  const ProgramResult of_a = a.wait(60), of_b = b.wait(60);
  EXPECT_EQ(of_a.exit_code, 0) << of_a.err;
  EXPECT_EQ(of_b.exit_code, 0) << of_b.err;
  expect_as_simulated("a", "1");
  expect_as_simulated("b", "2");
  // Heartbeats and the like; the kernel's filter drops the ticks of the other.
  EXPECT_GT(refused("a") + refused("b"), 0);
}

// In a run that is on, the late one ends and the run goes on: a message must not end it.
TEST_F(Sessions, AProcessWithAnotherConfigThatComesLateEndsAndTheRunGoesOn) {
  Program run({"twinrate", "launch", "dilys2021", "--run-dir", path("run"), "--duration", "600s"});
  std::error_code error;
  ASSERT_TRUE(wait_until([&] {
    const auto size = std::filesystem::file_size(path("run") + "/log.lcm", error);
    return !error && size > 200'000;
  }));
  const std::vector<std::string> arguments =
      arguments_of(processes_with(path("run"), "twinrate-gain").front());
  const auto session = std::find(arguments.begin(), arguments.end(), "--session");
  ASSERT_NE(session, arguments.end());
  Program gain({"twinrate-gain", "--config", path("run") + "/config.toml", "--session",
                *(session + 1), "--set", "gain.policy=immediate"});
  const ProgramResult of_gain = gain.wait(10);
  EXPECT_NE(of_gain.err.find("different drive files"), std::string::npos) << of_gain.err;
  const auto size_then = std::filesystem::file_size(path("run") + "/log.lcm");
  EXPECT_TRUE(wait_until(
      [&] { return std::filesystem::file_size(path("run") + "/log.lcm") > size_then + 200'000; }));
  run.signal_group(SIGINT);
  const ProgramResult of_run = run.wait(10);
  EXPECT_NE(of_run.out.find("interrupted"), std::string::npos) << of_run.out;
  EXPECT_EQ(of_run.err.find("different drive files"), std::string::npos) << of_run.err;
  EXPECT_EQ(of_gain.exit_code, 1);
}

// As somebody starts it by mistake: with the arguments of the one that runs.
TEST_F(Sessions, ASecondProcessOfARoleEndsAndTheRunGoesOn) {
  Program run({"twinrate", "launch", "dilys2021", "--run-dir", path("run"), "--duration", "600s"});
  std::error_code error;
  ASSERT_TRUE(wait_until([&] {
    const auto size = std::filesystem::file_size(path("run") + "/log.lcm", error);
    return !error && size > 200'000;
  }));
  for (const char* program : {"twinrate-plant", "twinrate-estimator", "twinrate-gain",
                              "twinrate-controller", "twinrate-logger"}) {
    const std::vector<std::string> arguments =
        arguments_of(processes_with(path("run"), program).front());
    Program second(arguments);
    const ProgramResult result = second.wait(10);
    EXPECT_EQ(result.exit_code, 2) << program;
    const std::string why = program == std::string("twinrate-logger")
                                ? "log.lcm"  // the log of the first one is not overwritten
                                : "of this session runs already";
    EXPECT_NE(result.err.find(why), std::string::npos) << result.err;
  }
  run.signal_group(SIGINT);
  const ProgramResult of_run = run.wait(10);
  EXPECT_EQ(of_run.out.find("TRIPPED"), std::string::npos) << of_run.out << of_run.err;
  EXPECT_EQ(of_run.out.find("peer_timeout"), std::string::npos) << of_run.out;
  EXPECT_NE(of_run.out.find("as controller is refused"), std::string::npos) << of_run.out;
}

TEST_F(Sessions, ASetStartedByHandRunsAndRefusesAMemberWithAnotherConfig) {
  const std::vector<std::string> common = {
      "--config", "dilys2021",          "--session", "77",
      "--set",    "run.duration_s=0.1", "--set",     "bus.peer_timeout_s=1"};
  const auto with = [&](const std::string& program, std::vector<std::string> more = {}) {
    std::vector<std::string> list = {program};
    list.insert(list.end(), common.begin(), common.end());
    list.insert(list.end(), more.begin(), more.end());
    return list;
  };
  for (const bool mismatch : {false, true}) {
    SCOPED_TRACE(mismatch);
    const std::string run = path(mismatch ? "mismatch" : "match");
    std::filesystem::create_directory(run);
    Program logger(with("twinrate-logger", {"--run-dir", run}));
    Program gain(with("twinrate-gain", mismatch ? std::vector<std::string>{"--set", "rates.n=4"}
                                                : std::vector<std::string>{}));
    Program estimator(with("twinrate-estimator")), controller(with("twinrate-controller"));
    Program plant(with("twinrate-plant"));
    const ProgramResult of_plant = plant.wait(30);
    if (mismatch) {
      // A process that receives the mismatch ends; a later one waits for the process that ended. The
      // gain process itself may be the later one.
      EXPECT_EQ(of_plant.exit_code, 1) << of_plant.err;
      const ProgramResult of_gain = gain.wait(5);
      EXPECT_EQ(of_gain.exit_code, 1);
      const std::string said =
          of_gain.err + estimator.wait(5).err + controller.wait(5).err + of_plant.err;
      const std::regex mismatched("(gain and [a-z]+|[a-z]+ and gain) have different drive files");
      EXPECT_TRUE(std::regex_search(said, mismatched)) << said;
      continue;
    }
    EXPECT_EQ(of_plant.exit_code, 0) << of_plant.err;
    for (Program* program : {&gain, &estimator, &controller, &logger}) {
      program->signal(SIGTERM);
      EXPECT_EQ(program->wait(5).exit_code, 0);
    }
    ASSERT_EQ(
        twinrate({"simulate", "dilys2021", "--duration", "0.1s", "--run-dir", path("simulated")})
            .exit_code,
        0);
    EXPECT_TRUE(same_messages(run, path("simulated"), 500));
  }
}

}  // namespace
}  // namespace twinrate::test::sessions_test
