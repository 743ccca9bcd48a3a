// Requests for a later tick: how far ahead they may be, which were applied, and the load that a log declares.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "core/arbiter.hpp"
#include "core/config.hpp"
#include "core/declared_load.hpp"
#include "core/steering.hpp"

namespace twinrate {
namespace {

reply_t answer_to(double tick) {
  reply_t answer{};
  int applied = 0;
  Arbiter arbiter({.next_tick = [] { return std::int64_t{1000}; },
                   .ticks = INT64_MAX,
                   .ahead_ticks = 600'000,
                   .members = [] { return std::set<int>{}; },
                   .prepare = [](const request_t&) {},
                   .apply = [&](const request_t&) { ++applied; },
                   .ask = [](const request_t&) {},
                   .answer = [&](reply_t reply) { answer = std::move(reply); },
                   .event = [](Reason, std::int64_t, const std::string&) {},
                   .released = [] {}});
  request_t request{};
  request.seq = 7;
  request.kind = static_cast<std::int32_t>(RequestKind::kSteer);
  request.value = tick;
  request.text = "load_Nm=0.01";
  arbiter.take(request, {});
  EXPECT_EQ(applied, answer.accepted);
  return answer;
}

TEST(SteeringRequests, OneForATickFarAheadIsRefusedInOneLine) {
  EXPECT_EQ(answer_to(601'000).applied_seq, 601'000);
  for (const double tick : {601'001.0, 999'999'999.0, 1e18}) {
    const reply_t answer = answer_to(tick);
    EXPECT_EQ(answer.accepted, 0) << tick;
    EXPECT_NE(answer.text.find("up to tick 601000 allowed now, 60 s ahead"), std::string::npos)
        << answer.text;
  }
  EXPECT_EQ(answer_to(0).applied_seq, 1000);
}

TEST(SteeringRequests, ARefusalIsGivenOnceEveryProcessHasReplied) {
  constexpr int kGain = static_cast<int>(Role::kGain),
                kEstimator = static_cast<int>(Role::kEstimator);
  int prepares = 0;
  std::vector<reply_t> answers;
  Arbiter arbiter({.next_tick = [] { return std::int64_t{1000}; },
                   .ticks = INT64_MAX,
                   .members =
                       [] {
                         return std::set<int>{kEstimator, kGain};
                       },
                   .prepare = [](const request_t&) {},
                   .apply = [](const request_t&) { FAIL() << "it is refused"; },
                   .ask =
                       [&](const request_t& asked) {
                         prepares += asked.kind == static_cast<std::int32_t>(RequestKind::kPrepare);
                       },
                   .answer = [&](reply_t reply) { answers.push_back(std::move(reply)); },
                   .event = [](Reason, std::int64_t, const std::string&) {},
                   .released = [] {}});
  request_t request{};
  request.seq = 7;
  request.kind = static_cast<std::int32_t>(RequestKind::kAddEffect);
  arbiter.take(request, {});
  const auto reply = [&](int role, bool accepted, const char* text) {
    reply_t one{};
    one.seq = 7;
    one.role = role;
    one.accepted = accepted;
    one.applied_seq = -1;
    one.text = text;
    arbiter.take(one);
  };
  reply(kEstimator, false, "no such effect");
  EXPECT_TRUE(answers.empty()) << "the gain did not hear the request, and is asked again";
  std::this_thread::sleep_for(std::chrono::duration<double>(2 * Arbiter::kRepeat_s));
  arbiter.turn();
  EXPECT_EQ(prepares, 2);
  reply(kGain, true, "");
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].accepted, 0);
  EXPECT_EQ(answers[0].text, "no such effect");
}

TEST(SteeringRequests, OneOfASetThatStartsStaysUntilEveryProcessWasHeard) {
  bool heard = false;
  int applied = 0, answers = 0;
  Arbiter arbiter({.next_tick = [] { return std::int64_t{1000}; },
                   .ticks = INT64_MAX,
                   .ahead_ticks = 600'000,
                   .members =
                       [&] {
                         if (!heard) throw BadInput("no heartbeat of the estimator");
                         return std::set<int>{};
                       },
                   .prepare = [](const request_t&) {},
                   .apply = [&](const request_t&) { ++applied; },
                   .ask = [](const request_t&) { FAIL() << "of nobody"; },
                   .answer = [&](const reply_t& reply) { answers += reply.accepted; },
                   .event = [](Reason, std::int64_t, const std::string&) {},
                   .released = [] {}});
  request_t request{};
  request.seq = 7;
  request.kind = static_cast<std::int32_t>(RequestKind::kSteer);
  request.text = "n=3";
  arbiter.take(request, {});
  arbiter.take(request, {});  // again
  arbiter.turn();
  EXPECT_EQ(applied, 0);
  heard = true;
  arbiter.turn();
  arbiter.turn();
  EXPECT_EQ(applied, 1);
  EXPECT_EQ(answers, 1);
}

// Holder and monitor are known by their sockets: a name is no authority.
TEST(SteeringRequests, WhoOnlyGivesTheNameOfTheHolderOrOfTheMonitorIsRefusedAndCounted) {
  constexpr Arbiter::Asker kPage{.socket = 1, .is_monitor = false},
      kOther{.socket = 2, .is_monitor = false}, kMonitor{.socket = 3, .is_monitor = true};
  reply_t answer{};
  int refused = 0;
  Arbiter arbiter({.next_tick = [] { return std::int64_t{1000}; },
                   .ticks = INT64_MAX,
                   .ahead_ticks = 600'000,
                   .members = [] { return std::set<int>{}; },
                   .prepare = [](const request_t&) {},
                   .apply = [](const request_t&) {},
                   .ask = [](const request_t&) {},
                   .answer = [&](reply_t reply) { answer = std::move(reply); },
                   .event = [](Reason, std::int64_t, const std::string&) {},
                   .released = [] {},
                   .refused = [&] { ++refused; }});
  std::int64_t seq = 0;
  const auto ask = [&](RequestKind kind, const std::string& text, const Arbiter::Asker& asker,
                       double value = 0) {
    request_t request{};
    request.seq = request.t_ns = ++seq;
    request.kind = static_cast<std::int32_t>(kind);
    request.text = text;
    request.value = value;
    arbiter.take(request, asker);
    return answer.accepted != 0;
  };
  const auto steer = RequestKind::kSteer, take = RequestKind::kTakeControl;
  EXPECT_TRUE(ask(steer, "holder=page\nn=3", kOther)) << "nobody has control";
  EXPECT_TRUE(ask(take, "page", kPage));
  EXPECT_TRUE(ask(steer, "holder=page\nn=4", kPage));
  EXPECT_EQ(refused, 0);
  EXPECT_FALSE(ask(steer, "holder=page\nn=5", kOther));
  EXPECT_EQ(answer.text, "page has control");
  EXPECT_FALSE(ask(RequestKind::kReset, "holder=page\n", kOther));
  EXPECT_FALSE(ask(take, "page", kOther));
  EXPECT_FALSE(ask(take, "page", kOther, 1)) << "its heartbeat";
  EXPECT_FALSE(ask(RequestKind::kGiveControl, "page", kOther));
  EXPECT_FALSE(ask(RequestKind::kAddEffect, "holder=monitor\n", kOther));
  EXPECT_EQ(refused, 6);
  EXPECT_TRUE(ask(RequestKind::kAddEffect, "holder=monitor\n", kMonitor));
  EXPECT_TRUE(ask(steer, "stop", kOther)) << "everybody may stop";
  EXPECT_TRUE(ask(take, "page", kPage, 1)) << "its heartbeat";
  EXPECT_TRUE(ask(RequestKind::kGiveControl, "page", kPage));
  EXPECT_EQ(refused, 6);
}

// steering.hold_s counts from the second of silence on that makes the event.
TEST(SteeringRequests, ASilentHolderKeepsTheControlForTheTimeOfTheHold) {
  for (const double hold_s : {3600.0, 0.0}) {
    std::vector<Reason> events;
    int applied = 0;
    Arbiter arbiter({.next_tick = [] { return std::int64_t{1000}; },
                     .ticks = INT64_MAX,
                     .ahead_ticks = 600'000,
                     .hold_s = hold_s,
                     .members = [] { return std::set<int>{}; },
                     .prepare = [](const request_t&) {},
                     .apply = [&](const request_t& request) { applied += request.text == "stop"; },
                     .ask = [](const request_t&) {},
                     .answer = [](const reply_t&) {},
                     .event = [&](Reason reason, std::int64_t,
                                  const std::string&) { events.push_back(reason); },
                     .released = [] {}});
    request_t request{};
    request.kind = static_cast<std::int32_t>(RequestKind::kTakeControl);
    request.text = "page";
    arbiter.take(request, {.socket = 1, .is_monitor = false});
    ASSERT_EQ(arbiter.holder(), "page");
    arbiter.turn();
    EXPECT_EQ(events.size(), 1u) << "taken, and not yet silent";
    std::this_thread::sleep_for(std::chrono::duration<double>(Arbiter::kSilent_s + 0.01));
    arbiter.turn();
    ASSERT_GE(events.size(), 2u);
    EXPECT_EQ(events[1], Reason::kControlLost);
    EXPECT_EQ(arbiter.holder(), hold_s > 0 ? "page" : "");
    EXPECT_EQ(applied, hold_s > 0 ? 0 : 1);
  }
}

TEST(SteeringRequests, WhatTheRunDidNotReachOrAnotherReplacedWasNotApplied) {
  const std::vector<AppliedSteering> requests = {{.k = 500, .lines = "speed_rpm=100\nload_Nm=1"},
                                                 {.k = 900, .lines = "n=3"},
                                                 {.k = 300, .lines = "stop"},
                                                 {.k = 400, .lines = "load_Nm=2"},
                                                 {.k = 2000, .lines = "load_Nm=3"}};
  EXPECT_EQ(why_not_applied(requests, 0, 1000), "not applied: replaced by the request of tick 400");
  for (const std::size_t applied : {1U, 2U, 3U})
    EXPECT_EQ(why_not_applied(requests, applied, 1000), "");
  EXPECT_EQ(why_not_applied(requests, 4, 1000), "not applied: the run ended before");
  EXPECT_EQ(why_not_applied(requests, 4, 2000), "");
}

TEST(DeclaredLoad, IsThatOfTheDriveFileAndThenOfTheRequests) {
  Config config = Config::parse(
      "preset = \"dilys2021\"\n[load]\nT_load_Nm = [[0, 0.001], [0.02, 0.003]]\n", "drive");
  const double T_s = config.drive().T_s();
  DeclaredLoad load(config.drive());
  SteeredDrive steered(config);
  for (const auto& [k, lines] :
       {std::pair(40, "load_Nm=0.005\nn=3"), std::pair(30, "speed_rpm=100"),
        std::pair(60, "load_Nm=-0.002"), std::pair(50, "load_Nm=0.004")}) {
    load.steer(k, lines);
    steered.apply(lines, k);
  }
  double T_load = 0;
  const LoadParameters& parameters = steered.drive().load;
  for (int k = 0; k < 150; ++k) {
    T_load = slew(T_load, parameters.T_load_Nm.at(k * T_s), parameters.slew_Nm_s, T_s);
    EXPECT_EQ(load.at(k * T_s), T_load) << k;
  }
  EXPECT_DOUBLE_EQ(T_load, 0.004);
}

}  // namespace
}  // namespace twinrate
