// The log of a run is readable after the end of its writer or a full disk.
#include <fmt/format.h>

#include <csignal>
#include <filesystem>
#include <lcm/lcm-cpp.hpp>
#include <nlohmann/json.hpp>

#include "core/channels.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

namespace fs = std::filesystem;

class Logger : public ProgramTest {
 protected:
  std::uintmax_t size(const std::string& file) const {
    std::error_code error;
    const std::uintmax_t bytes = fs::file_size(file, error);
    return error ? 0 : bytes;
  }
};

TEST_F(Logger, KilledItLeavesALogThatEveryReaderTakes) {
  Program launch(
      {"twinrate", "launch", "dilys2021", "--run-dir", path("run"), "--duration", "600s"});
  const std::string log = path("run") + "/log.lcm";
  ASSERT_TRUE(wait_until([&] { return size(log) > 500'000; })) << launch.err();
  kill(processes_with(path("run"), "twinrate-logger").front(), SIGKILL);
  EXPECT_EQ(launch.wait(8).exit_code, 1);

  lcm::LogFile file(log, "r");
  std::int64_t events = 0, whole_bytes = 0;
  while (const lcm::LogEvent* event = file.readNextEvent()) {
    ++events;
    whole_bytes += 28 + static_cast<std::int64_t>(event->channel.size()) + event->datalen;
  }
  EXPECT_GT(events, 1000);
  EXPECT_LT(static_cast<std::int64_t>(size(log)) - whole_bytes, 2000)
      << "only the last record may be cut";

  const ProgramResult player = run_program({"lcm-logplayer", "-s", "1000", log}, 20);
  EXPECT_EQ(player.exit_code, 0) << player.err;
  // A cut record is damage: refused, and played with --repair, but never as a whole run.
  const ProgramResult refused = twinrate({"replay", log, "--lockstep"}, 60);
  const ProgramResult repaired = twinrate({"replay", log, "--lockstep", "--repair"}, 60);
  if (static_cast<std::int64_t>(size(log)) > whole_bytes) {
    EXPECT_EQ(refused.exit_code, 2) << refused.err;
    EXPECT_NE(refused.err.find("cut off"), std::string::npos) << refused.err;
  }
  EXPECT_EQ(repaired.exit_code, 1) << repaired.err;
  EXPECT_EQ(repaired.out.find("bit for bit"), std::string::npos) << repaired.out;
  EXPECT_NE(repaired.out.find(" 0 different"), std::string::npos) << repaired.out;
}

TEST_F(Logger, RotatedPartsEachBeginWithTheManifestAndJoinToTheWholeRun) {
  const ProgramResult result = twinrate({"launch", "dilys2021", "--run-dir", path("run"),
                                         "--duration", "0.4s", "--set", "bus.log_rotate_MB=0.2"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  ASSERT_EQ(twinrate({"simulate", "dilys2021", "--run-dir", path("whole"), "--duration", "0.4s"})
                .exit_code,
            0);
  const std::vector<std::string> parts = log_parts(path("run"));
  EXPECT_GE(parts.size(), 8u);
  for (const std::string& part : parts) {
    lcm::LogFile file(part, "r");
    const lcm::LogEvent* first = file.readNextEvent();
    ASSERT_NE(first, nullptr) << part;
    EXPECT_EQ(first->channel, info(Channel::kManifest).name) << part;
    EXPECT_LT(size(part), 230'000u);
  }
  EXPECT_TRUE(same_messages(path("run"), path("whole"), 2000));
  EXPECT_EQ(nlohmann::json::parse(read_text(path("run") + "/manifest.json"))["log"]["files"].size(),
            parts.size());
  EXPECT_EQ(twinrate({"replay", path("run"), "--lockstep"}).exit_code, 0);

  // A finished run is replaced only with --force. No part of the longer one is left behind.
  std::vector<std::string> again = {"launch",    "dilys2021",  "--run-dir",
                                    path("run"), "--duration", "0.1s"};
  EXPECT_EQ(twinrate(again).exit_code, 2);
  EXPECT_EQ(log_parts(path("run")).size(), parts.size());
  again.push_back("--force");
  ASSERT_EQ(twinrate(again).exit_code, 0);
  EXPECT_EQ(log_parts(path("run")).size(), 1u);
}

class FullDisk : public Logger, public ::testing::WithParamInterface<const char*> {};

TEST_P(FullDisk, EndsTheRunWithOneClearLineAndAReadableLog) {
  if (!mount_small_disk("disk", "400k")) GTEST_SKIP() << "mounting is not permitted here";
  const std::string run = path("disk") + "/run";
  const ProgramResult result =
      twinrate({GetParam(), "dilys2021", "--run-dir", run, "--duration", "2s"}, 30);
  ASSERT_FALSE(result.timed_out);
  EXPECT_EQ(result.exit_code, 1);
  std::istringstream lines(result.err);
  int said = 0;
  for (std::string line; std::getline(lines, line);)
    if (line.rfind("twinrate: ", 0) == 0) {
      ++said;
      EXPECT_NE(line.find("the disk is full"), std::string::npos) << line;
    }
  EXPECT_EQ(said, 1) << result.err;
  EXPECT_NE(result.out.find("ended early"), std::string::npos) << result.out;

  const RunLog log = read_run_log(run, "", OnDamage::kSkip);
  EXPECT_NE(log.damage.find("the log does not end"), std::string::npos) << log.damage;
  EXPECT_GT(log.measurement.size(), 50u);
  EXPECT_LT(log.measurement.size(), 2000u);
  EXPECT_NE(result.err.find(fmt::format("the log holds {} whole ticks", log.command.size())),
            std::string::npos)
      << result.err << log.command.size();
  EXPECT_EQ(log.measurement.size(), log.command.size());
  EXPECT_EQ(nlohmann::json::parse(read_text(run + "/summary.json"))["steps"].get<std::size_t>(),
            log.command.size());
  lcm::LogFile file(run + "/log.lcm", "r");
  std::int64_t whole_bytes = 0;
  while (const lcm::LogEvent* event = file.readNextEvent())
    whole_bytes += 28 + static_cast<std::int64_t>(event->channel.size()) + event->datalen;
  EXPECT_EQ(whole_bytes, size(run + "/log.lcm")) << "the log ends with a whole event";
  EXPECT_TRUE(processes_with(run).empty());
}

INSTANTIATE_TEST_SUITE_P(System, FullDisk, ::testing::Values("launch", "simulate"),
                         [](const auto& verb) { return std::string(verb.param); });

TEST_F(Logger, AFullDiskIsTheCauseThatARealtimeRunNames) {
  if (!mount_small_disk("disk", "400k")) GTEST_SKIP() << "mounting is not permitted here";
  const std::string run = path("disk") + "/run";
  const ProgramResult result = twinrate({"launch", "dilys2021", "--run-dir", run, "--duration",
                                         "5s", "--pace", "realtime", "--set", "rates.f_s_Hz=1000"},
                                        30);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("twinrate: " + run + "/log.lcm: the disk is full"), std::string::npos)
      << result.err;
  const std::size_t ticks = read_run_log(run, "", OnDamage::kSkip).measurement.size();
  EXPECT_GT(ticks, 50u);
  EXPECT_NE(result.err.find(fmt::format("the log ends before tick {}", ticks)), std::string::npos)
      << result.err << ticks;
}

TEST_F(Logger, AFullDiskUnderALaterPartEndsTheRunToo) {
  if (!mount_small_disk("disk", "700k")) GTEST_SKIP() << "mounting is not permitted here";
  const std::string run = path("disk") + "/run";
  const ProgramResult result = twinrate({"launch", "dilys2021", "--run-dir", run, "--duration",
                                         "2s", "--set", "bus.log_rotate_MB=0.2"},
                                        30);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("the disk is full"), std::string::npos) << result.err;
  EXPECT_GT(read_run_log(run, "", OnDamage::kSkip).measurement.size(), 50u);
}

}  // namespace
}  // namespace twinrate::test
