// Realtime pace: no process waits; late messages are counted and reported with their tick. Lock is
// not tested: it depends on other load on the machine.
#include <sched.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

class Realtime : public ProgramTest {
 protected:
  std::vector<std::string> launch(const char* duration) const {
    return {"twinrate", "launch",   "dilys2021",  "--run-dir", path("run"),
            "--pace",   "realtime", "--duration", duration};
  }
  nlohmann::json summary() const {
    return nlohmann::json::parse(read_text(path("run") + "/summary.json"));
  }
  bool wait_for_log(std::uintmax_t bytes) const {
    return wait_until([&] {
      std::error_code error;
      const auto size = std::filesystem::file_size(path("run") + "/log.lcm", error);
      return !error && size > bytes;
    });
  }
  std::vector<EventRecord> events(const RunLog& log, Reason reason) const {
    std::vector<EventRecord> found;
    for (const EventRecord& event : log.events)
      if (event.reason == static_cast<int>(reason)) found.push_back(event);
    return found;
  }
  // Where this test may have SCHED_FIFO, the set has it, in the order of its priorities.
  void expect_scheduled_as_asked() const {
    const bool allowed = may_have_fifo();
    const auto priority = [](pid_t pid) {
      sched_param p{};
      sched_getparam(pid, &p);
      return p.sched_priority;
    };
    for (const char* program : {"twinrate-plant", "twinrate-estimator", "twinrate-controller"})
      EXPECT_EQ(priority(processes_with(path("run"), program).at(0)), allowed ? 20 : 0) << program;
    for (const char* program : {"twinrate-gain", "twinrate-logger", "twinrate"})
      EXPECT_EQ(priority(processes_with(path("run"), program).at(0)), allowed ? 19 : 0) << program;
  }
  static bool may_have_fifo() {
    sched_param p{};
    p.sched_priority = 20;
    if (sched_setscheduler(0, SCHED_FIFO, &p) != 0) return false;
    p.sched_priority = 0;
    sched_setscheduler(0, SCHED_OTHER, &p);
    return true;
  }
  void expect_ended_cleanly(const ProgramResult& result) {
    ASSERT_FALSE(result.timed_out) << result.err;
    EXPECT_LE(result.exit_code, 1) << result.err;
    EXPECT_EQ(result.out.find("ended early"), std::string::npos) << result.out;
    EXPECT_TRUE(processes_with(path("run")).empty());
  }
};

// "COMMAND(4) was late: .. (2 more ..)" tells of three, "2 more commands were late .." of two.
std::int64_t late_commands_of(const std::string& text) {
  const std::size_t bracket = text.find(" (");
  if (text.rfind("COMMAND(", 0) != 0) return std::stoll(text);
  return 1 + (bracket == std::string::npos ? 0 : std::stoll(text.substr(bracket + 2)));
}

TEST_F(Realtime, ARunTakesItsTimeAndItsCountsAgreeWithItsLog) {
  const ProgramResult result = Program(launch("1s")).wait(20);
  expect_ended_cleanly(result);
  const RunLog log = read_run_log(path("run"));
  const nlohmann::json s = summary();
  EXPECT_EQ(s["steps"], 5000);
  EXPECT_EQ(log.measurement.size(), 5000u);
  const nlohmann::json manifest = nlohmann::json::parse(read_text(path("run") + "/manifest.json"));
  const nlohmann::json& hops = manifest["latency_us"];
  EXPECT_GT(hops["rounds"], 4000);
  EXPECT_EQ(manifest["scheduling"].get<std::string>().find("SCHED_FIFO 20,") == 0, may_have_fifo())
      << manifest["scheduling"];
  EXPECT_GT(hops["round"]["p50"], hops["to_estimate"]["p50"]);
  EXPECT_GT(hops["round"]["p99"], hops["round"]["p50"]);
  EXPECT_LT(hops["round"]["p50"], 1e6);
  EXPECT_GT(s["wall_s"], 0.95);
  EXPECT_LT(s["wall_s"], 1.2);
  std::int64_t late_estimates = 0;
  for (const Estimate& e : log.estimate)
    if (e.status & kLateGain) ++late_estimates;
  EXPECT_EQ(s["late_gains"], late_estimates);
  // The events count all of them, up to a trip: a long stall of the machine trips the drive to the
  // end.
  const std::vector<EventRecord> late = events(log, Reason::kLateCommand),
                                 lost = events(log, Reason::kCommandLost);
  const std::int64_t after_trip = lost.empty() ? 0 : 5000 - lost[0].k;
  std::int64_t told = 0;
  for (const EventRecord& event : late) told += late_commands_of(event.text);
  EXPECT_LE(lost.size(), 1u);
  EXPECT_GE(s["late_commands"], told);
  EXPECT_LE(s["late_commands"], told + after_trip);
  for (const EventRecord& event : events(log, Reason::kLateGain)) EXPECT_GE(event.k, 0);
}

// Two rings on one CPU want more than the kernel gives realtime processes: it halts both.
TEST_F(Realtime, ASecondSetTakesTheOtherCpuAndSaysSo) {
  const auto slow = [this](const char* dir, const char* duration) {
    return std::vector<std::string>{"twinrate", "launch", "dilys2021",        "--run-dir",
                                    path(dir),  "--pace", "realtime",         "--duration",
                                    duration,   "--set",  "rates.f_s_Hz=1000"};
  };
  Program first(slow("run", "20s"));
  ASSERT_TRUE(wait_for_log(50'000));
  const ProgramResult second = Program(slow("second", "0.2s")).wait(20);
  ASSERT_FALSE(second.timed_out);
  EXPECT_NE(second.err.find("another realtime set runs on this machine (" + path("run") + ")"),
            std::string::npos)
      << second.err;
  const bool can_be_pinned = std::thread::hardware_concurrency() >= 2;
  EXPECT_EQ(second.err.find("that of this set on CPU ") != std::string::npos, can_be_pinned)
      << second.err;
  first.signal(SIGINT);
  EXPECT_FALSE(first.wait(20).timed_out);
}

// A plant that does not run for 20 ms is a stall: its clock stands, and no command is missed by it.
TEST_F(Realtime, AStoppedGainProcessMakesGainsLateAndNothingElse) {
  Program run(launch("2s"));
  ASSERT_TRUE(wait_for_log(300'000));
  const pid_t plant = processes_with(path("run"), "twinrate-plant").at(0);
  kill(plant, SIGSTOP);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  kill(plant, SIGCONT);
  const pid_t gain = processes_with(path("run"), "twinrate-gain").at(0);
  expect_scheduled_as_asked();
  kill(gain, SIGSTOP);
  const std::uintmax_t then = std::filesystem::file_size(path("run") + "/log.lcm");
  ASSERT_TRUE(wait_for_log(then + 500'000));
  kill(gain, SIGCONT);
  const ProgramResult result = run.wait(20);
  expect_ended_cleanly(result);
  const RunLog log = read_run_log(path("run"));
  EXPECT_EQ(log.measurement.size(), 10000u);
  EXPECT_GT(summary()["late_gains"], 100);
  EXPECT_TRUE(events(log, Reason::kCommandLost).empty());
  EXPECT_GE(summary()["stalls"], 1);
  EXPECT_GE(summary()["longest_stall_s"], 0.0195);
  EXPECT_GE(summary()["stalled_s"], summary()["longest_stall_s"]);
  ASSERT_FALSE(events(log, Reason::kLateGain).empty());
  const std::int64_t k = events(log, Reason::kLateGain).front().k;
  EXPECT_TRUE(log.estimate.at(static_cast<std::size_t>(k)).status & kLateGain);
}

// Killed: the gain table, until the process that is started again sends gains.
TEST_F(Realtime, AKilledGainProcessIsReplacedByTheTableAndThenByANewOne) {
  Program run(launch("2s"));
  ASSERT_TRUE(wait_for_log(300'000));
  kill(processes_with(path("run"), "twinrate-gain").at(0), SIGKILL);
  const ProgramResult result = run.wait(20);
  ASSERT_FALSE(result.timed_out);
  EXPECT_EQ(result.exit_code, 1) << "gains were lost";
  const RunLog log = read_run_log(path("run"));
  EXPECT_EQ(log.measurement.size(), 10000u) << "to its end";
  EXPECT_EQ(events(log, Reason::kProcessDied).size(), 0u);
  EXPECT_EQ(events(log, Reason::kProcessLost).size(), 2u) << "ended; rejoins";
  EXPECT_EQ(events(log, Reason::kSecondSender).size(), 0u) << "the new one is expected";
  ASSERT_FALSE(events(log, Reason::kGainScheduled).empty());
  ASSERT_FALSE(events(log, Reason::kGainBack).empty());
  // The widest hole in the gains: the last one is held 4 n = 20 ticks from its snapshot, no longer
  // and no shorter, and the new ones begin at a snapshot.
  std::int64_t before = 0, after = 0;
  for (std::size_t i = 1; i < log.gain.size(); ++i)
    if (log.gain[i].k - log.gain[i - 1].k > after - before) {
      before = log.gain[i - 1].k;
      after = log.gain[i].k;
    }
  ASSERT_GT(after - before, 20);  // a fast machine has the new one within 40 ticks
  EXPECT_EQ(after % 5, 0);
  for (const Estimate& e : log.estimate) {
    if (e.k > before + 20 && e.k < after) {
      ASSERT_TRUE(e.status & kScheduledGain) << e.k;
    }
    if (e.k > before + 10 && e.k <= before + 20) {
      ASSERT_EQ(e.gain_seq, before) << e.k;
    }
  }
  EXPECT_GT(log.gain.back().k, 9900);
  EXPECT_GT(log.estimate.back().gain_seq, 9800);
}

TEST_F(Realtime, AGainProcessThatEndsTheFourthTimeIsNotStartedAgain) {
  Program run(launch("2s"));
  ASSERT_TRUE(wait_for_log(300'000));
  std::set<pid_t> killed;
  for (int time = 1; time <= 4; ++time) {
    ASSERT_TRUE(wait_until([&] {
      for (const pid_t pid : processes_with(path("run"), "twinrate-gain"))
        if (killed.insert(pid).second) return kill(pid, SIGKILL) == 0;
      return false;
    })) << "start "
        << time;
  }
  const ProgramResult result = run.wait(20);
  ASSERT_FALSE(result.timed_out);
  const RunLog log = read_run_log(path("run"));
  EXPECT_EQ(log.measurement.size(), 10000u) << "to its end";
  std::vector<bool> again;  // of the events of an end
  for (const EventRecord& event : events(log, Reason::kProcessLost))
    if (event.text.find("ended with") != std::string::npos)
      again.push_back(event.text.find("started again") != std::string::npos);
  EXPECT_EQ(again, (std::vector<bool>{true, true, true, false}));
}

TEST_F(Realtime, AKilledLoggerIsStartedAgainWhereTheDriveFileSaysSo) {
  std::vector<std::string> arguments = launch("2s");
  arguments.insert(arguments.end(), {"--set", "logger.on_loss=restart"});
  Program run(arguments);
  ASSERT_TRUE(wait_for_log(300'000));
  kill(processes_with(path("run"), "twinrate-logger").at(0), SIGKILL);
  const ProgramResult result = run.wait(20);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1) << "messages were lost";
  ASSERT_TRUE(std::filesystem::exists(path("run") + "/log-001.lcm"));
  const RunLog log = read_run_log(path("run"));  // both parts are whole
  EXPECT_LT(log.measurement.size(), 10000u);
  EXPECT_EQ(log.measurement.front().k, 0);
  EXPECT_EQ(log.measurement.back().k, 9999);
  EXPECT_GE(events(log, Reason::kLogLost).size(), 1u);
  EXPECT_EQ(events(log, Reason::kSecondSender).size(), 0u) << "the new one is expected";
  EXPECT_EQ(summary()["lost_messages"]["DRIVE_MEASUREMENT"], 10000 - log.measurement.size());
}

// Off within safety.hold_ms of drive time, and the run ends soon after, with the culprit named.
TEST_F(Realtime, AFrozenControllerSwitchesOffAndEndsTheRun) {
  Program run(launch("60s"));
  ASSERT_TRUE(wait_for_log(300'000));
  kill(processes_with(path("run"), "twinrate-controller").at(0), SIGSTOP);
  const ProgramResult result = run.wait(20);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("controller stopped answering"), std::string::npos) << result.err;
  EXPECT_TRUE(processes_with(path("run")).empty());
  const RunLog log = read_run_log(path("run"));
  EXPECT_LT(log.measurement.size(), 60u * 5000);
  const std::vector<EventRecord> lost = events(log, Reason::kCommandLost);
  ASSERT_EQ(lost.size(), 1u);
  EXPECT_EQ(summary()["trip"]["name"], "command_lost");
  for (const Measurement& m : log.measurement)
    if (m.k > lost.front().k) {
      ASSERT_EQ(m.u_alphabeta, Vec2::Zero()) << m.k;
      ASSERT_EQ(m.mode, Mode::kSafe) << m.k;
    }
  EXPECT_GT(summary()["late_commands"], 20);
  // The log shows who it was: every process sends a heartbeat each 0.1 s, it none for 0.35 s. The supervisor
  // wakes it at the end, so it has a last one.
  const auto beats = heartbeats(path("run"));
  const auto widest_gap = [&](Role role) {
    double gap = 0;
    const std::vector<double>& times = beats.at(role);
    for (std::size_t i = 1; i < times.size(); ++i) gap = std::max(gap, times[i] - times[i - 1]);
    return gap;
  };
  ASSERT_TRUE(beats.contains(Role::kController));
  EXPECT_GT(widest_gap(Role::kController), 0.3);
  for (const Role role :
       {Role::kSupervisor, Role::kPlant, Role::kEstimator, Role::kGain, Role::kLogger}) {
    ASSERT_TRUE(beats.contains(role)) << static_cast<int>(role);
    EXPECT_GT(beats.at(role).size(), 2u) << static_cast<int>(role);
    EXPECT_LT(widest_gap(role), widest_gap(Role::kController)) << static_cast<int>(role);
  }
}

// The commands of the stopped time come in a burst: they are late, and SAFE is latched.
TEST_F(Realtime, AControllerThatStoppedForAMomentSwitchesOffAndItsLateCommandsAreNotReplayed) {
  Program run(launch("1s"));
  ASSERT_TRUE(wait_for_log(300'000));
  const pid_t controller = processes_with(path("run"), "twinrate-controller").at(0);
  kill(controller, SIGSTOP);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  kill(controller, SIGCONT);
  const ProgramResult result = run.wait(20);
  ASSERT_FALSE(result.timed_out) << result.err;
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_EQ(summary()["trip"]["name"], "command_lost");
  const std::string text = summary()["trip"]["text"];
  EXPECT_NE(text.find("the controller answered ESTIMATE("), std::string::npos) << text;
  const RunLog log = read_run_log(path("run"));
  EXPECT_EQ(log.measurement.size(), 5000u) << "to its end";
  ASSERT_EQ(events(log, Reason::kCommandLost).size(), 1u);
  for (const Measurement& m : log.measurement)
    if (m.k > events(log, Reason::kCommandLost).front().k) {
      ASSERT_EQ(m.u_alphabeta, Vec2::Zero()) << m.k;
      ASSERT_EQ(m.mode, Mode::kSafe) << m.k;
    }
}

// A plant that works for a period and more is never asleep. On the one CPU of the ring its equals would not
// run: 8 of 10 such runs tripped.
TEST_F(Realtime, ALatePlantLeavesItsCpuToEstimatorAndController) {
  if (!may_have_fifo()) GTEST_SKIP() << "SCHED_FIFO is not allowed here";
  for (int run = 0; run < 3; ++run) {
    std::vector<std::string> arguments = launch("0.3s");
    for (const char* key : {"plant.engine=cvode", "rates.f_s_Hz=10000", "rates.n=10",
                            "plant.hold_ticks=5", "run.settle_s=0.1"})
      arguments.insert(arguments.end(), {"--set", key});
    arguments.push_back("--force");
    const ProgramResult result = Program(arguments).wait(20);
    ASSERT_FALSE(result.timed_out) << result.err;
    EXPECT_TRUE(summary()["trip"].is_null()) << summary()["trip"];
  }
}

TEST_F(Realtime, AFrozenSupervisorSwitchesOffAndLeavesNoOrphan) {
  Program run(launch("60s"));
  ASSERT_TRUE(wait_for_log(300'000));
  run.signal(SIGSTOP);
  const bool gone = wait_until([&] { return processes_with(path("run")).size() == 1; }, 10);
  run.signal(SIGCONT);
  EXPECT_TRUE(gone);
  const ProgramResult result = run.wait(20);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("supervisor"), std::string::npos) << result.err;
  const RunLog log = read_run_log(path("run"), "", OnDamage::kSkip);
  ASSERT_FALSE(events(log, Reason::kSupervisorLost).empty());
  EXPECT_EQ(log.measurement.back().mode, Mode::kSafe);
}

TEST_F(Realtime, WithoutItsLoggerTheDriveGoesOnWhereTheDriveFileSaysSo) {
  std::vector<std::string> arguments = launch("2s");
  arguments.insert(arguments.end(), {"--set", "logger.on_loss=go_on"});
  Program run(arguments);
  ASSERT_TRUE(wait_for_log(300'000));
  kill(processes_with(path("run"), "twinrate-logger").at(0), SIGKILL);
  const ProgramResult result = run.wait(20);
  ASSERT_FALSE(result.timed_out);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_GT(result.wall_s, 2) << "to its end";
  EXPECT_NE(result.err.find("twinrate-logger ended with signal 9"), std::string::npos)
      << result.err;
}

}  // namespace
}  // namespace twinrate::test
