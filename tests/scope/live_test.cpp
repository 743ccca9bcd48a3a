// The scope beside a launched drive: what it captured against the log of the run.
#include <gtest/gtest.h>

#include <cmath>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "model/frames.hpp"
#include "scope/recorded_drive.hpp"
#include "scope/scope.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

using ScopeTest = ProgramTest;

constexpr const char* kSignals[] = {"measurement.i_a_A",          "measurement.theta_m_rad",
                                    "truth.omega_m_rad_s",        "estimate.theta_e_rad",
                                    "estimate.x_hat[3]",          "command.u_alpha_V",
                                    "reference.omega_m_ref_rad_s"};

struct Held {
  std::int64_t from, to, missing;
  std::vector<std::vector<double>> values;
};

Held copy(scope::Recording& recording, const nlohmann::ordered_json& capture) {
  Held held{capture["from"], capture["to"], capture["missing"], {}};
  for (const char* signal : kSignals)
    held.values.push_back(recording.samples(signal, {held.from, held.to, 1, capture["id"]}));
  return held;
}

// The drive runs until twenty were copied, however many pass by meanwhile: the scope keeps ten.
TEST_F(ScopeTest, TwentyCapturesHoldEveryTickOfTheLog) {
  constexpr std::size_t kCaptures = 20;
  scope::Scope scope({.port = 0, .runs_directory = ""});
  scope.recording().set_trigger({.mode = scope::TriggerMode::kNormal,
                                 .signal = "measurement.i_a_A",
                                 .edge = scope::Edge::kRising,
                                 .level = 0,
                                 .hysteresis = 0.01,
                                 .length_ticks = 120});
  Program drive({"twinrate", "launch", "dilys2021", "--duration", "60s", "--pace", "wall", "--set",
                 "reference.omega_e_rad_s=400", "--run-dir", path("run")});
  std::map<int, Held> captures;
  while (drive.running() && captures.size() < kCaptures) {
    const auto brief = scope.recording().brief();
    for (const auto& capture : brief["captures"])
      if (!captures.count(capture["id"]))
        captures.emplace(capture["id"], copy(scope.recording(), capture));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  drive.signal_group(SIGINT);
  EXPECT_EQ(drive.wait(30).exit_code, 1) << drive.err();
  ASSERT_GE(captures.size(), kCaptures) << scope.recording().brief().dump(1);
  scope::Recording log(1e9, 512 << 20);
  EXPECT_EQ(scope::load_log(path("run"), log), "");
  for (const auto& [id, held] : captures) {
    EXPECT_EQ(held.missing, 0) << id;
    EXPECT_TRUE(held.to - held.from == 120 || held.from == 0) << id;
    for (std::size_t s = 0; s < std::size(kSignals); ++s) {
      const auto logged = log.samples(kSignals[s], {held.from, held.to, 1, 0});
      for (std::size_t i = 0; i < logged.size(); ++i)
        ASSERT_TRUE(!std::isnan(logged[i]) && held.values[s][i] == logged[i])
            << "capture " << id << ", " << kSignals[s] << ", tick "
            << held.from + static_cast<std::int64_t>(i);
    }
  }
  // The history is the log too: nothing was lost on the way.
  EXPECT_TRUE(wait_until([&] { return scope.recording().last_k() == log.last_k(); }));
  const auto now = scope.recording().extent("truth.omega_m_rad_s", {0, log.last_k() + 1, 1, 0});
  EXPECT_EQ(now.count, log.extent("truth.omega_m_rad_s", {0, log.last_k() + 1, 1, 0}).count);
  EXPECT_EQ(scope.recording().drive().n_p, 4);
}

// A launched set takes requests of its token alone: the page finds it in the run directory.
TEST_F(ScopeTest, ThePageSteersAndStopsTheDrive) {
  Program drive({"twinrate", "launch", "dilys2021", "--duration", "60s", "--run-dir", path("run")});
  ASSERT_TRUE(wait_until([&] { return std::filesystem::exists(path("run/token")); }));
  scope::Scope scope({.port = 0,
                      .token_of = [&](std::int64_t) { return path("run/token"); },
                      .runs_directory = ""});
  ASSERT_TRUE(wait_until([&] { return scope.recording().last_k() > 500; }));
  scope::LiveDrive& live = *scope.live();
  const auto only = [](const scope::Steering::Replies& replies) {
    return replies.size() == 1 ? replies.front() : scope::SteeringReply{};
  };
  EXPECT_TRUE(only(live.take_control()).accepted);
  const scope::SteeringReply slower = only(live.steer("speed_rpm=500"));
  EXPECT_TRUE(slower.accepted) << slower.text;
  EXPECT_GT(slower.applied_k, 500);
  const scope::SteeringReply wrong = only(live.steer("speed_rpm=fast"));
  EXPECT_FALSE(wrong.accepted);
  EXPECT_NE(wrong.text, "");
  ASSERT_TRUE(wait_until([&] {
    const auto speed = scope.recording().samples("reference.omega_m_ref_rad_s",
                                                 {slower.applied_k, slower.applied_k + 1, 1, 0});
    return !speed.empty() && std::abs(speed.front() - 500 * kTwoPi / 60) < 1e-9;
  }));
  live.emergency_stop();
  ASSERT_TRUE(wait_until([&] {
    for (const scope::ScopeEvent& e : scope.recording().event_list())
      if (e.reason == "emergency_stop") return true;
    return false;
  }));
  drive.signal(SIGINT);
  drive.wait(30);
}

}  // namespace
}  // namespace twinrate::test
