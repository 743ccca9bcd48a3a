// Steering a running set: one tick for all, and a log that repeats it.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <thread>
#include <utility>

#include "core/authority.hpp"
#include "core/bus.hpp"
#include "core/config.hpp"
#include "core/drive_hand.hpp"
#include "core/event_log.hpp"
#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "drive_log/log_reader.hpp"
#include "model/frames.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

constexpr int kWholeReplies = 5;  // plant, estimator, gain, controller, logger

request_t phase_of_the_plant(RequestKind kind) {
  request_t request{};
  request.seq = 4711;
  request.kind = static_cast<std::int32_t>(kind);
  request.value = static_cast<double>(RequestKind::kSteer);
  request.text = "n=7";
  return request;
}

class Steering : public ProgramTest {
 protected:
  std::string run() const { return path("run"); }
  // A set that runs until stop(); it has passed a few ticks.
  void launch(std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"twinrate",
                                          "launch",
                                          "dilys2021",
                                          "--duration",
                                          "inf",
                                          "--run-dir",
                                          run(),
                                          "--set",
                                          "rates.f_s_Hz=2000",
                                          "--set",
                                          "reference.omega_e_rad_s=250"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    set_.emplace(arguments);
    ASSERT_TRUE(wait_until([&] {
      std::error_code error;
      return std::filesystem::file_size(run() + "/log.lcm", error) > 200'000 && !error;
    })) << set_->err();
  }
  ProgramResult stop() {
    set_->signal(SIGINT);
    return set_->wait(20);
  }
  ProgramResult steer(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), "set");
    arguments.insert(arguments.end(), {"--run-dir", run()});
    return twinrate(arguments);
  }
  std::optional<Program> set_;
};

// Every answer in a log to each request that was applied: role -> tick.
std::map<std::int64_t, std::map<int, std::int64_t>> applied_in(const std::string& directory) {
  std::map<std::int64_t, std::map<int, std::int64_t>> applied;
  EventLog events(directory, OnDamage::kRefuse);
  constexpr std::int64_t kOfTheSupervisor = 1000;  // its requests are counted from 0
  while (const lcm::LogEvent* event = events.next()) {
    reply_t reply;
    if (events.channel() != Channel::kReply || reply.decode(event->data, 0, event->datalen) < 0)
      continue;
    if (reply.seq > kOfTheSupervisor && reply.accepted != 0 && reply.applied_seq >= 0)
      applied[reply.seq][reply.role] = reply.applied_seq;
  }
  return applied;
}

// omega_m_ref by tick.
std::vector<double> references_in(const std::string& directory) {
  std::vector<double> references;
  EventLog events(directory, OnDamage::kRefuse);
  while (const lcm::LogEvent* event = events.next()) {
    reference_t reference;
    if (events.channel() == Channel::kReference &&
        reference.decode(event->data, 0, event->datalen) > 0)
      references.push_back(reference.omega_m_ref_rad_s);
  }
  return references;
}

// The messages of the ticks below `ticks`.
std::vector<LoggedMessage> first_ticks(const std::string& directory, std::int64_t ticks) {
  std::vector<LoggedMessage> messages = tick_messages(directory);
  std::erase_if(messages, [&](const LoggedMessage& m) { return m.seq >= ticks; });
  return messages;
}

TEST_F(Steering, ARunFromTheSavedFileIsTheSteeredRunAndSoIsItsReplay) {
  launch({"--pace", "wall"});
  for (const std::vector<std::string>& request :
       std::vector<std::vector<std::string>>{{"omega_e_rad_s=200", "load_Nm=0.004"},
                                             {"n=7"},
                                             {"policy=scheduled"},
                                             {"policy=rotor_frame", "n=3"},
                                             {"speed_rpm=450"},
                                             {"policy=propagated"},
                                             {"stop"},
                                             {"start"}}) {
    const ProgramResult result = steer(request);
    EXPECT_EQ(result.exit_code, 0) << fmt::format("{}", request) << result.err;
    EXPECT_TRUE(result.out.starts_with("tick ")) << result.out;
    std::this_thread::sleep_for(std::chrono::milliseconds(40));  // some ticks between the requests
  }
  const ProgramResult ended = stop();
  EXPECT_EQ(ended.exit_code, 0) << ended.out << ended.err;
  EXPECT_FALSE(std::filesystem::exists(run() + "/session.json"));
  // No single n and policy hold for the run.
  const auto read = [](const std::string& file) {
    std::ifstream in(file);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  EXPECT_EQ(nlohmann::json::parse(read(run() + "/summary.json"))["rates_requested"], true);
  EXPECT_NE(ended.out.find("in the drive file; for requests see the events"), std::string::npos)
      << ended.out;
  EXPECT_NE(read(run() + "/report.html").find("in the drive file; for requests see the events"),
            std::string::npos);

  const ProgramResult saved = twinrate({"set", "--save", path("saved.toml"), "--run-dir", run()});
  ASSERT_EQ(saved.exit_code, 0) << saved.err;
  EXPECT_NE(saved.out.find("8 requests"), std::string::npos) << saved.out;
  ASSERT_EQ(twinrate({"simulate", path("saved.toml"), "--run-dir", path("again")}).exit_code, 0);
  const RunLog log = read_run_log(run());
  const std::int64_t ticks = log.command.back().k + 1;
  const std::vector<LoggedMessage> steered = first_ticks(run(), ticks),
                                   again = first_ticks(path("again"), ticks);
  ASSERT_EQ(steered.size(), again.size());
  const auto [a, b] = std::mismatch(steered.begin(), steered.end(), again.begin());
  EXPECT_TRUE(a == steered.end()) << a->channel << "(" << a->seq << ")";

  // The load of rows for `trace` and `export` is the steered one: this plant has no other torque.
  const auto reader = open_log(run(), nullptr, false, 24);
  RawLog rows;
  ASSERT_TRUE(reader->next(rows, SIZE_MAX));
  ASSERT_GT(rows.size(), 200u);
  for (std::size_t k = 0; k < rows.size(); ++k)
    ASSERT_EQ(rows.T_load.at(k), log.truth.at(k + 1).T_load) << k;
  ASSERT_EQ(twinrate({"export", run(), "--format", "csv", "--out", path("run.csv")}).exit_code, 0);
  const auto exported = open_log(path("run.csv"), nullptr, false, 24);
  RawLog exported_rows;
  ASSERT_TRUE(exported->next(exported_rows, SIZE_MAX));
  EXPECT_EQ(exported_rows.T_load, rows.T_load);

  const ProgramResult replayed = twinrate({"replay", "--lockstep", run()});
  EXPECT_EQ(replayed.exit_code, 0) << replayed.out << replayed.err;
  EXPECT_NE(replayed.out.find(fmt::format("{} equal to the log bit for bit, 0 different",
                                          log.measurement.size())),
            std::string::npos)
      << replayed.out;
}

TEST_F(Steering, TwentyRequestsAreEachAppliedAtOneTickByAllFiveProcesses) {
  launch();
  DriveHand hand(find_running_set(run()));
  std::map<std::int64_t, double> loads;  // by tick
  for (int i = 1; i <= 20; ++i) {
    const double load = 1e-4 * i;
    // A set that stands still for some milliseconds would take two requests at one tick.
    const std::int64_t earliest = loads.empty() ? 0 : loads.rbegin()->first + 1;
    const HandAnswer answer = hand.steer(
        fmt::format("load_Nm={}\nn={}\nomega_e_rad_s={}", load, 1 + i % 6, 200 + i), earliest);
    ASSERT_TRUE(answer.accepted) << answer.why;
    loads[answer.k] = load;
  }
  const HandAnswer later = hand.steer("load_Nm=0", loads.rbegin()->first + 300);
  EXPECT_EQ(later.k, loads.rbegin()->first + 300);
  // Not before the last of them: a request drops the changes of its key that are due later.
  ASSERT_TRUE(wait_until([&] { return hand.steer("load_Nm=0.001", later.k + 1).k > later.k + 5; }));
  EXPECT_EQ(stop().exit_code, 0);

  EXPECT_EQ(loads.size(), 20u);  // each at a tick of its own
  const auto applied = applied_in(run());
  EXPECT_GE(applied.size(), 21u);
  for (const auto& [request, ticks] : applied) {
    EXPECT_EQ(ticks.size(), static_cast<std::size_t>(kWholeReplies)) << request;
    std::set<std::int64_t> different;
    for (const auto& [role, k] : ticks) different.insert(k);
    EXPECT_EQ(different.size(), 1u) << fmt::format("{}", ticks);
  }
  const RunLog log = read_run_log(run());
  const std::vector<double> omega_m_ref = references_in(run());
  int number = 0;
  for (const auto& [k, load] : loads) {
    const auto at = static_cast<std::size_t>(k);
    EXPECT_NEAR(log.truth.at(at + 1).T_load - log.truth.at(at).T_load, 1e-4, 2e-6) << k;
    EXPECT_DOUBLE_EQ(omega_m_ref.at(at) * 4, 200 + ++number) << k;
    EXPECT_NE(omega_m_ref.at(at - 1), omega_m_ref.at(at)) << k;
  }
}

TEST_F(Steering, WhatTheDriveCannotDoIsRefusedInOneLineAndChangesNothing) {
  launch({"--pace", "wall"});
  const std::vector<std::pair<std::vector<std::string>, std::string>> wrong = {
      {{"speed_rpm=1e6"}, "speed_rpm=1e6: -"},
      {{"load_Nm=1000"}, "load_Nm=1000: -"},
      {{"n=2.5"}, "n=2.5: a whole number from 1 to 100000 allowed"},
      {{"n=3", "n=4"}, "n: once in a request allowed"},
      {{"policy=newest"}, "policy=newest: one of paper, immediate"},
      {{"compensation=paper"}, "needs an estimator.kind that estimates the load"},
      {{"speed_rpm"}, "speed_rpm: KEY=VALUE, start or stop allowed"},
      {{"speed=1"}, "speed: one of speed_rpm, omega_e_rad_s, load_Nm"},
      {{"start"}, "start: the drive was not stopped"},
      {{"reset"}, "the drive is not off"},
      {{"load_Nm=0.001", "--tick", "999999999"}, "tick 999999999: up to tick "},
      {{"load_Nm=0.001", "emergency_stop"}, "emergency_stop: alone and without --tick allowed"},
      {{}, "nothing to set"}};
  for (const auto& [request, text] : wrong) {
    const ProgramResult result = steer(request);
    EXPECT_EQ(result.exit_code, 2) << fmt::format("{}", request);
    EXPECT_NE(result.err.find(text), std::string::npos) << result.err;
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
  }
  const ProgramResult ended = stop();
  EXPECT_EQ(ended.exit_code, 0) << ended.out;
  for (const EventRecord& event : read_run_log(run()).events)
    EXPECT_NE(event.reason, static_cast<int>(Reason::kSteered)) << event.text;
  EXPECT_EQ(steer({"n=3"}).exit_code, 2);  // nothing runs any more
}

TEST_F(Steering, OneHolderAtATimeAndASilentOneLeadsToAStop) {
  launch({"--pace", "wall", "--set", "steering.hold_s=0.1", "--set", "steering.ramp_rad_s2=4000"});
  {
    DriveHand page(find_running_set(run()), "page"), other(find_running_set(run()), "other");
    EXPECT_TRUE(page.take_control().accepted);
    EXPECT_EQ(other.take_control().why, "page has control");
    EXPECT_EQ(other.steer("n=3").why, "page has control");
    EXPECT_EQ(other.ask(RequestKind::kSteer, "holder=page\nn=3").why, "page has control");
    for (const RequestKind phase : {RequestKind::kPrepare, RequestKind::kApplyAt})
      other.bus().publish(phase_of_the_plant(phase));
    EXPECT_EQ(other.reset().why, "page has control");
    const std::string friction =
        "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.001\nused_in = \"model\"\n";
    EXPECT_EQ(other.add_effect(friction).why, "page has control");
    EXPECT_TRUE(page.add_effect(friction).accepted);
    EXPECT_EQ(other.remove_effect(friction).why, "page has control");
    EXPECT_TRUE(page.remove_effect(friction).accepted);
    EXPECT_EQ(page.reset().why, "the drive is not off");
    EXPECT_TRUE(page.steer("n=3").accepted);
    EXPECT_TRUE(other.stop().accepted);
    EXPECT_TRUE(page.steer("start").accepted);
  }  // silent from here on
  DriveHand later(find_running_set(run()), "later");
  EXPECT_TRUE(wait_until([&] { return later.take_control().accepted; }, 5));
  EXPECT_TRUE(later.steer("n=4").accepted);
  EXPECT_TRUE(later.give_control().accepted);
  DriveHand back(find_running_set(run()), "page");  // a page that comes back
  for (int i = 0; i < 20; ++i, std::this_thread::sleep_for(std::chrono::milliseconds(10)))
    back.beat();
  EXPECT_FALSE(back.has_control());
  EXPECT_TRUE(later.take_control().accepted);
  stop();
  const RunLog log = read_run_log(run());
  int lost = 0;
  std::vector<std::string> steered;
  for (const EventRecord& event : log.events) {
    lost += event.reason == static_cast<int>(Reason::kControlLost);
    if (event.reason == static_cast<int>(Reason::kSteered)) steered.push_back(event.text);
  }
  EXPECT_EQ(lost, 2);
  EXPECT_EQ(steered, (std::vector<std::string>{"n=3", "stop", "start", "stop", "n=4"}));
  for (const char* text : {"that only the plant may send: ", "from a sender without control: "})
    EXPECT_TRUE(std::any_of(log.events.begin(), log.events.end(), [&](const EventRecord& event) {
      return event.reason == static_cast<int>(Reason::kRequestRefused) &&
             event.text.find(text) != std::string::npos;
    })) << text;
  EXPECT_EQ(references_in(run()).back(), 0);
}

TEST_F(Steering, AnEmergencyStopNeedsNoControlAndSaysItsTick) {
  launch({"--pace", "wall"});
  DriveHand page(find_running_set(run()), "page");
  EXPECT_TRUE(page.take_control().accepted);
  const ProgramResult result = steer({"emergency_stop"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const std::int64_t k = std::stoll(result.out.substr(5));
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  EXPECT_EQ(stop().exit_code, 1);  // a tripped run
  const RunLog log = read_run_log(run());
  const auto at = static_cast<std::size_t>(k);
  ASSERT_GT(log.measurement.size(), at + 1);
  EXPECT_NE(log.measurement[at].u_alphabeta.norm(), 0);      // t_{k-1} to t_k
  EXPECT_EQ(log.measurement[at + 1].u_alphabeta.norm(), 0);  // t_k to t_{k+1}
}

// One that no request asked for: the summary of the set is that of the loop in one process.
TEST_F(Steering, AnEmergencyStopOfTheDriveFileIsATripOfTheSetToo) {
  for (const char* verb : {"simulate", "launch"}) {
    const ProgramResult result = twinrate({verb, "dilys2021", "--duration", "0.4s", "--set",
                                           "steering.emergency=[[0.3,\"stop\"]]", "--set",
                                           "run.settle_s=0.1", "--run-dir", path(verb)});
    EXPECT_EQ(result.exit_code, 1) << verb << result.out;
    const auto trip = nlohmann::json::parse(read_text(path(verb) + "/summary.json"))["trip"];
    ASSERT_FALSE(trip.is_null()) << verb;
    EXPECT_EQ(trip["name"], "emergency_stop") << verb;
    EXPECT_EQ(trip["tick"], 1500) << verb;
  }
}

TEST_F(Steering, AnEmergencyStopAndAResetAreRepeatedByTheSavedFileAndTheReplay) {
  launch({"--pace", "wall"});
  EXPECT_EQ(steer({"emergency_stop"}).exit_code, 0);
  EXPECT_EQ(steer({"reset"}).exit_code, 0);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(steer({"speed_rpm=300"}).exit_code, 0);
  std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(stop().exit_code, 1);  // a tripped run
  const ProgramResult saved = twinrate({"set", "--save", path("saved.toml"), "--run-dir", run()});
  EXPECT_EQ(saved.exit_code, 0) << saved.err;
  const std::int64_t ticks = read_run_log(run()).command.back().k + 1;
  for (const char* verb : {"simulate", "launch"}) {
    twinrate({verb, path("saved.toml"), "--run-dir", path(verb)});
    EXPECT_TRUE(first_ticks(run(), ticks) == first_ticks(path(verb), ticks)) << verb;
  }
  const ProgramResult replayed = twinrate({"replay", "--lockstep", run()});
  EXPECT_NE(replayed.out.find("equal to the log bit for bit, 0 different"), std::string::npos)
      << replayed.out;
}

// The error of a tick is that of its estimate and its truth, and the line misses nothing. At the pace of
// the wall clock: who only listens cannot hold a set back that is faster than the listener.
TEST_F(Steering, TheLiveLineOnATerminalAndInJsonMissesNothingAndShowsOneTick) {
  write_text(path("launch"),
             fmt::format("{} launch dilys2021 --pace wall --duration 1s --set rates.n=5 "
                         "--set rates.n_from=locked --json --run-dir {} && {} "
                         "launch dilys2021 --pace wall --duration 4s --run-dir {}",
                         TWINRATE_PROGRAM, run(), TWINRATE_PROGRAM, path("b")));
  Program watch({"script", "-qec", std::string(TWINRATE_PROGRAM) + " watch --duration 30s",
                 path("watch.txt")});
  const ProgramResult result =
      run_program({"script", "-qec", "sh " + path("launch"), path("launch.txt")});
  ASSERT_EQ(result.exit_code, 0) << result.out;
  watch.signal_group(SIGINT);
  watch.wait(5);
  const std::string text = read_text(path("launch.txt")), view = read_text(path("watch.txt"));
  EXPECT_NE(text.find("losses 0"), std::string::npos) << text;
  EXPECT_EQ(text.find("losses 1"), std::string::npos) << text;

  const RunLog log = read_run_log(run());
  int lines = 0;
  const std::regex line(
      R"re("t_s": ([0-9.]+),.*"angle_error_rad": ([-0-9.]+),.*"losses": (\d+))re");
  for (std::sregex_iterator it(text.begin(), text.end(), line), end; it != end; ++it, ++lines) {
    const auto k = static_cast<std::size_t>(std::lround(std::stod((*it)[1]) * 5000));
    const double error = wrap_pi(log.estimate.at(k).theta_e - 4 * log.truth.at(k).theta_m);
    EXPECT_NEAR(std::stod((*it)[2]), error, 1e-5) << k;
    EXPECT_EQ((*it)[3], "0");
  }
  EXPECT_GT(lines, 0) << text;

  int rows = 0;
  const std::regex row(R"re((DRIVE_[A-Z]+) +\d+ +(-?\d+) +(\d+) +\d+)re");
  for (std::sregex_iterator it(view.begin(), view.end(), row), end; it != end; ++it, ++rows)
    EXPECT_EQ((*it)[3], "0") << it->str();
  EXPECT_GT(rows, 10) << view;
}

TEST_F(Steering, EffectsWithoutATickAreAddedAtOneTickAndAReplayRepeatsThem) {
  launch({"--set", "estimator.kind=ekf_disturbance"});
  write_text(path("own.toml"),
             "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.001\nused_in = \"model\"\n");
  const ProgramResult added = twinrate({"monitor", "add", path("own.toml"), "--run-dir", run()});
  EXPECT_EQ(added.exit_code, 0) << added.err;
  EXPECT_EQ(steer({"load_Nm=0.002"}).exit_code, 0);
  const ProgramResult removed =
      twinrate({"set", "--remove-effects", path("own.toml"), "--run-dir", run()});
  EXPECT_EQ(removed.exit_code, 0) << removed.err;
  const ProgramResult again =
      twinrate({"set", "--add-effects", path("own.toml"), "--run-dir", run()});
  EXPECT_EQ(again.exit_code, 0) << again.err;
  const std::int64_t last = std::stoll(again.out.substr(5));
  ASSERT_TRUE(
      wait_until([&] { return std::stoll(steer({"load_Nm=0.001"}).out.substr(5)) > last + 20; }));
  stop();
  const ProgramResult replayed = twinrate({"replay", "--lockstep", run()});
  EXPECT_EQ(replayed.exit_code, 0) << replayed.out << replayed.err;
  EXPECT_NE(replayed.out.find("equal to the log bit for bit, 0 different"), std::string::npos)
      << replayed.out;

  const ProgramResult saved = twinrate({"set", "--save", path("saved.toml"), "--run-dir", run()});
  EXPECT_NE(saved.out.find("3 changes of the model"), std::string::npos) << saved.out << saved.err;
  ASSERT_EQ(twinrate({"simulate", path("saved.toml"), "--run-dir", path("again")}).exit_code, 0);
  const std::int64_t whole = read_run_log(run()).command.back().k + 1;
  EXPECT_TRUE(first_ticks(run(), whole) == first_ticks(path("again"), whole));
  const ProgramResult launched =
      twinrate({"launch", path("saved.toml"), "--run-dir", path("third")});
  EXPECT_EQ(launched.exit_code, 0) << launched.out << launched.err;
  EXPECT_TRUE(first_ticks(run(), whole) == first_ticks(path("third"), whole));

  const auto applied = applied_in(run());
  ASSERT_GE(applied.size(), 5u);
  for (const auto& [request, at] : applied) {
    std::set<std::int64_t> ticks;
    for (const auto& [role, k] : at) ticks.insert(k);
    EXPECT_EQ(ticks.size(), 1u) << fmt::format("{}", at);
    EXPECT_EQ(at.size(), static_cast<std::size_t>(kWholeReplies));
  }
}

// The plant hears each process every 0.1 s: that is 2000 ticks here. A request that is sent once
// before that stays with the plant until it knows who has to agree.
TEST_F(Steering, OneThatIsSentOnceInTheFirstTicksAppliesAtOneTickInEveryProcess) {
  set_.emplace(std::vector<std::string>{"twinrate", "launch", "dilys2021", "--duration", "2s",
                                        "--run-dir", run()});
  ASSERT_TRUE(wait_until([&] { return std::filesystem::exists(run() + "/token"); }));
  bool sent = false;
  {
    RunningSet set;
    ASSERT_TRUE(wait_until([&] {
      try {
        return set = find_running_set(run()), true;
      } catch (const BadInput&) {
        return false;
      }
    }));
    Bus bus({.session = set.session, .role = Role::kReplay, .token_file = run() + "/token"});
    bus.subscribe<measurement_t>([&](const measurement_t&) {
      if (std::exchange(sent, true)) return;
      request_t request{};
      request.seq = 1'000'000;
      request.t_ns = 1;
      request.kind = static_cast<std::int32_t>(RequestKind::kSteer);
      request.text = "n=7";
      bus.publish(request);
    });
    ASSERT_TRUE(wait_until([&] { return bus.handle(5), sent || !set_->running(); }));
  }
  const ProgramResult result = set_->wait(30);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const auto applied = applied_in(run());
  ASSERT_EQ(applied.size(), 1u);
  std::set<std::int64_t> ticks;
  for (const auto& [role, k] : applied.begin()->second) ticks.insert(k);
  EXPECT_EQ(ticks.size(), 1u);
  EXPECT_EQ(applied.begin()->second.size(), static_cast<std::size_t>(kWholeReplies));
}

}  // namespace
}  // namespace twinrate::test
