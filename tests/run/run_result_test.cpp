// What becomes of a run: its verdict, its exit code, and what the loop knows of an added effect.
#include "run/run_result.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/make_event.hpp"
#include "core/manifest.hpp"
#include "core/signals_io.hpp"
#include "logger/tick_log.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "run/progress.hpp"

namespace twinrate::run_result_test {
namespace {

namespace fs = std::filesystem;

class RunResult : public testing::Test {
 public:
  RunResult()
      : config_(
            load_drive("dilys2021", {"run.duration_s=0.1", "run.settle_s=0.02", "start=flying"})),
        directory_(fs::temp_directory_path() / ("twinrate-result-" + std::to_string(getpid()))) {
    fs::remove_all(directory_);
    fs::create_directories(directory_);
  }
  ~RunResult() override { fs::remove_all(directory_); }

  // A run of so many ticks and what the logger counted as lost of one channel.
  int conclude(std::int64_t ticks, const std::string& channel = "", int lost = 0) {
    LogWriter writer(directory_.string(), 100'000'000);
    writer.set_manifest(info(Channel::kManifest).name,
                        encode(make_manifest(1, config_.resolved(), "{}")), 0);
    TickLog log(writer, TickLog::Order::kByTick, config_.drive(), "", 0);
    ClosedLoop loop(config_);
    const auto put = [&](const auto& signal) {
      const auto wire = to_wire(signal, 1);
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(wire.getEncodedSize()));
      wire.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      log.take(kChannelOf<std::decay_t<decltype(wire)>>, wire.seq, wire.t_ns, bytes.data(),
               bytes.size());
    };
    while (loop.k() < ticks) {
      const TickRecord& tick = loop.step();
      put(tick.measurement), put(tick.truth), put(tick.estimate);
      if (tick.has_gain) put(tick.gain);
      put(tick.reference), put(tick.command);
    }
    for (const event_t& event : events_) {
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(event.getEncodedSize()));
      event.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      log.take(Channel::kEvent, event.seq, event.t_ns, bytes.data(), bytes.size());
    }
    log.close();
    writer.finish();
    nlohmann::json account;
    account["files"] = {"log.lcm"};
    for (const char* name : {"DRIVE_REFERENCE", "DRIVE_ESTIMATE"})
      account["channels"][name] = {{"received", ticks}, {"lost", name == channel ? lost : 0}};
    std::ofstream(directory_ / "logger.json") << account.dump();
    testing::internal::CaptureStdout();
    const int code =
        conclude_run(directory_.string(), config_, {.tags_checked = tags_checked_, .how = "test"});
    printed_ = testing::internal::GetCapturedStdout();
    return code;
  }
  nlohmann::json json(const char* name) const {
    return nlohmann::json::parse(std::ifstream(directory_ / name));
  }

  // The controller of this drive learnt the current limit.
  void learnt(std::int64_t k, const std::string& i_max_A, Role role = Role::kController) {
    events_.push_back(make_event({.role = role,
                                  .reason = Reason::kLearnt,
                                  .k = k,
                                  .t_ns = config_.drive().t_ns(k),
                                  .text = "\n[controller.foc.startup]\n" + i_max_A}));
  }
  std::string learnt_file() const {
    std::ifstream file(directory_ / "learnt.toml");
    return {std::istreambuf_iterator<char>(file), {}};
  }

  Config config_;
  fs::path directory_;
  std::string printed_;
  std::vector<event_t> events_;
  bool tags_checked_ = true;
};

TEST_F(RunResult, AWholeLockedRunIsWell) {
  EXPECT_EQ(conclude(500), 0);
  EXPECT_EQ(json("summary.json")["locked"], true);
  EXPECT_FALSE(json("manifest.json").contains("ended_early"));
}

TEST_F(RunResult, LateTicksAreOneLineForEachCauseAndItIsTheWorst) {
  const auto late = [&](std::int64_t k, const char* text) {
    events_.push_back(make_event({.role = Role::kPlant,
                                  .reason = Reason::kOverrun,
                                  .k = k,
                                  .t_ns = config_.drive().t_ns(k),
                                  .text = text}));
  };
  late(100, "tick began 120 us late: it was woken late");
  late(200, "tick began 3626 us late: it was woken late (21 more since the last report)");
  late(300, "tick began 150 us late: another process had the CPU for 130 us");
  late(400, "tick began 130 us late: it was woken late");
  conclude(500);
  EXPECT_NE(printed_.find("0.0400 s, plant: tick began 3626 us late: it was woken late (21 more "
                          "since the last report)  (3 times)\n"),
            std::string::npos)
      << printed_;
  EXPECT_NE(
      printed_.find("0.0600 s, plant: tick began 150 us late: another process had the CPU for "
                    "130 us\n"),
      std::string::npos)
      << printed_;
}

// Of channels whose ticks the log itself cannot count the logger's account is all there is.
TEST_F(RunResult, WhatTheLoggerLostIsInTheSummaryAndInTheExitCode) {
  EXPECT_EQ(conclude(500, "DRIVE_REFERENCE", 3), 1);
  EXPECT_EQ(json("summary.json")["lost_messages"]["DRIVE_REFERENCE"], 3);
  EXPECT_NE(printed_.find("messages lost          3"), std::string::npos) << printed_;
}

TEST_F(RunResult, ARunWithoutItsLastTickEndedEarly) {
  EXPECT_EQ(conclude(499), 1);
  EXPECT_EQ(json("manifest.json")["ended_early"], "stopped at tick 499 of 500");
}

// A recorded event can be sent again: it is of an earlier tick.
TEST_F(RunResult, WhatTheControllerLearntLastIsInTheLearntFile) {
  learnt(499, "i_start_A = 1.25\n");
  learnt(300, "i_start_A = 2.5\n");
  conclude(500);
  EXPECT_NE(learnt_file().find("\n[controller.foc.startup]\ni_start_A = 1.25\n"), std::string::npos)
      << learnt_file();
  EXPECT_EQ(learnt_file().find("i_start_A = 2.5"), std::string::npos);
}

TEST_F(RunResult, NobodyButTheControllerAndNothingButItsOwnTableIsLearnt) {
  learnt(499, "i_start_A = 1.25\n", Role::kEstimator);
  learnt(499, "i_start_A = 1.25\n[machine]\nR_s_Ohm = 1000\n");
  learnt(499, "i_start_A = 1.25\n");
  events_.back().text = "\n[machine]\nR_s_Ohm = 1000\n";
  conclude(500);
  EXPECT_FALSE(fs::exists(directory_ / "learnt.toml")) << learnt_file();
}

TEST_F(RunResult, WithoutAuthenticationNothingIsLearntAndTheTableSaysIt) {
  tags_checked_ = false;
  learnt(499, "i_start_A = 1.25\n");
  testing::internal::CaptureStderr();
  EXPECT_EQ(conclude(500), 0);
  EXPECT_NE(testing::internal::GetCapturedStderr().find("learnt.toml is not written"),
            std::string::npos);
  EXPECT_FALSE(fs::exists(directory_ / "learnt.toml"));
  EXPECT_NE(printed_.find("not authenticated (bus.authenticate = false)"), std::string::npos);
  EXPECT_EQ(json("manifest.json")["authenticated"], false);
}

TEST(RunDirectory, IsOneFolderBelowRunsWhateverTheNameOfTheDrive) {
  const fs::path before = fs::current_path(),
                 here = fs::temp_directory_path() / ("twinrate-name-" + std::to_string(getpid()));
  fs::create_directories(here);
  fs::current_path(here);
  for (const std::string name : {"../../x", "/etc/x", "a b\\x", ".", ""}) {
    const Config config = load_drive("dilys2021", {"name='" + name + "'"});
    const std::string path = make_run_directory("", config, false)->path();
    EXPECT_EQ(fs::path(path).parent_path(), "runs") << path;
    EXPECT_TRUE(fs::is_regular_file(here / path / "config.toml")) << path;
  }
  fs::current_path(before);
  fs::remove_all(here);
}

TEST(Duration, IsReadInItsUnit) {
  EXPECT_EQ(std::stod(seconds_text("2")), 2);
  EXPECT_EQ(std::stod(seconds_text("2.5s")), 2.5);
  EXPECT_EQ(std::stod(seconds_text("500ms")), 0.5);
  EXPECT_EQ(std::stod(seconds_text("5min")), 300);
  for (const char* bad : {"5h", "", "s", "5 s"}) EXPECT_THROW(seconds_text(bad), BadInput) << bad;
}

// 0.021 Nm of friction are 0.5 A of this motor: known to the controller, they are fed forward.
TEST(ClosedLoopKnows, AnAddedEffectIsCompensatedByTheController) {
  Config config = load_drive("dilys2021", {"start=flying", "controller.foc.compensate_effects=true",
                                           "controller.angle_source=measured"});
  ClosedLoop loop(config);
  while (loop.k() < 500) loop.step();
  const double before = loop.step().command.i_dq_ref[1];
  Config extended = config.with_effects(
      "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.021\nused_in = \"model\"\n", "test");
  read_all_tables(extended);
  loop.know(extended);
  EXPECT_NEAR(loop.step().command.i_dq_ref[1] - before, 0.5, 0.05);
}

}  // namespace
}  // namespace twinrate::run_result_test
