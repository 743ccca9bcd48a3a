// Something begins, ends or changes within a log: it is dated, and nothing is told of the whole log
// that holds in a part of it.
#include "trace/change_points.hpp"

#include <gtest/gtest.h>

#include "model/effects/registry.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/consistency.hpp"
#include "trace/keys.hpp"
#include "trace/split.hpp"

namespace twinrate {
namespace {

constexpr double kFriction_Nm = 0.3, kCogging_Nm = 0.25;

Record record_of(const RawLog& raw) {
  Health health;
  return make_record(raw, servo().machine.n_p, health);
}
TraceResult traced(const Record& record, std::vector<SourceRows> files = {}) {
  TraceSettings settings;
  settings.files = std::move(files);
  return trace_with_changes(record, servo(), {}, settings, {});
}
double friction(double omega) {
  return kFriction_Nm * std::tanh(omega / 0.02);
}
double cogging(double theta) {
  return kCogging_Nm * std::sin(12 * theta + 0.5);
}
const TracedEffect* find(const TraceResult& r, const std::string& kind) {
  for (const TracedEffect& e : r.effects)
    if (e.effect->kind() == kind) return &e;
  return nullptr;
}

TEST(ChangePoints, FrictionThatBeginsIsDatedAndActsFromThenOn) {
  constexpr double kBegin_s = 2.845;
  const TraceResult r = traced(record_of(simulate_synthetic(
      {.T_s = 2e-4, .duration_s = 6, .extra_load = [](double t, double, double omega) {
         return t < kBegin_s ? 0 : friction(omega);
       }})));
  ASSERT_EQ(r.changes.size(), 1u) << r.sentence;
  EXPECT_LT(r.changes[0].from_s, kBegin_s);
  EXPECT_GT(r.changes[0].to_s, kBegin_s);
  EXPECT_LT(r.changes[0].to_s - r.changes[0].from_s, 0.1);
  const TracedEffect* e = find(r, "coulomb_friction");
  ASSERT_TRUE(e) << r.sentence;
  EXPECT_NEAR(get_key(*e->effect, "torque_Nm"), kFriction_Nm, 0.02);
  EXPECT_TRUE(e->only_in_part);
  ASSERT_TRUE(e->from_s);
  EXPECT_NEAR(*e->from_s, kBegin_s, 0.02);
  EXPECT_FALSE(e->to_s);
}

TEST(ChangePoints, WhatActsThroughoutHasNoDate) {
  const TraceResult r = traced(record_of(simulate_synthetic(
      {.T_s = 2e-4, .duration_s = 6, .extra_load = [](double, double, double omega) {
         return friction(omega);
       }})));
  EXPECT_TRUE(r.changes.empty()) << r.sentence;
  ASSERT_TRUE(find(r, "coulomb_friction")) << r.sentence;
  EXPECT_FALSE(find(r, "coulomb_friction")->only_in_part);
}

TEST(ChangePoints, ALoadOfOneSideAloneIsALoadStep) {
  const Effects none, load = {make_constant_load()}, friction = {make_coulomb_friction()},
                      both = {make_coulomb_friction(), make_constant_load()};
  EXPECT_TRUE(differ_by_a_load(none, load));
  EXPECT_TRUE(differ_by_a_load(both, friction));
  EXPECT_FALSE(differ_by_a_load(none, friction));
  EXPECT_FALSE(differ_by_a_load(load, friction));
  EXPECT_TRUE(differ_by_a_load(load, load)) << "of another size";
  EXPECT_FALSE(differ_by_a_load(both, both)) << "either may have changed";
}

// At one speed and load, a winding that warms: neither another resistance from some moment on, nor the inductance of
// another machine.
TEST(ChangePoints, AWindingThatWarmsIsOneDrift) {
  const Record record = record_of(simulate_synthetic(
      {.duration_s = 4, .held = true, .R_warm = 0.25, .speeds = 4, .loads = 12}));
  EXPECT_TRUE(inconsistencies(record, {}, servo().facts(), 0).empty());
  const TraceResult r = traced(record);
  EXPECT_TRUE(r.changes.empty()) << r.sentence;
  const TracedEffect* e = find(r, "resistance");
  ASSERT_TRUE(e) << r.sentence;
  EXPECT_NEAR(get_key(*e->effect, "change_Ohm"), 0.25, 0.01);
  EXPECT_NEAR(get_key(*e->effect, "time_constant_s"), 2, 0.1);
}

// The cogging stays where it is; its angle is read from another zero.
// The rows between the last one before such a block and the first one behind it are the block's own.
TEST(LoadStep, AmongRowsThatJudgeIsDatedByThem) {
  constexpr double kStep_Nm = 0.3;
  const auto record_with = [](double begin_s) {
    return record_of(simulate_synthetic(
        {.T_s = 2e-4, .duration_s = 6, .extra_load = [begin_s](double t, double, double) {
           return t < begin_s ? 0 : kStep_Nm;
         }}));
  };
  const auto judging = [](const Record& record) {
    return held_out_rows(record, TraceSettings{}.holdout, servo().machine.n_p);
  };
  const Record plain = record_with(10);
  const std::vector<char> judges = judging(plain);
  const auto first = std::find(judges.begin() + 12000, judges.end(), char{1});
  const auto end = std::find(first, judges.end(), char{0});
  const auto middle = static_cast<std::size_t>(first - judges.begin() + (end - first) / 2);
  const Record record = record_with(plain.t[middle]);
  ASSERT_TRUE(judging(record)[middle]);
  const TraceResult r = traced(record);
  EXPECT_EQ(r.verdict, "traced") << r.sentence;
  const TracedEffect* e = find(r, "load_step");
  ASSERT_TRUE(e) << r.sentence;
  EXPECT_NEAR(get_key(*e->effect, "time_s"), plain.t[middle], 0.003);
  EXPECT_NEAR(get_key(*e->effect, "torque_Nm"), kStep_Nm, 0.01);
  EXPECT_FALSE(r.judging[middle]);
  EXPECT_TRUE(std::count(r.judging.begin(), r.judging.end(), char{1}) > 0);
}

// A weak step shortly behind such a block: beside the noise of the counts its moment may be before
// the block as well.
TEST(LoadStep, BesideRowsThatMayContainItIsDatedByThem) {
  constexpr double kStep_Nm = 0.15;
  const auto record_with = [](double begin_s) {
    return record_of(simulate_synthetic(
        {.T_s = 2e-4,
         .duration_s = 6,
         .extra_load = [begin_s](double t, double, double) { return t < begin_s ? 0 : kStep_Nm; },
         .counts = 1000}));
  };
  const Record plain = record_with(10);
  const std::vector<char> judges =
      held_out_rows(plain, TraceSettings{}.holdout, servo().machine.n_p);
  const auto first = std::find(judges.begin() + 12000, judges.end(), char{1});
  const auto end =
      static_cast<std::size_t>(std::find(first, judges.end(), char{0}) - judges.begin());
  const double begin_s = plain.t[end] + 0.012;
  const TraceResult r = traced(record_with(begin_s));
  EXPECT_EQ(r.verdict, "traced") << r.sentence;
  const TracedEffect* e = find(r, "load_step");
  ASSERT_TRUE(e) << r.sentence;
  EXPECT_NEAR(get_key(*e->effect, "time_s"), begin_s, 0.01);
  EXPECT_FALSE(r.judging[end - 1]);
}

// A fifth of a load that the log knows is missing: an error of that load, or of the torque constant.
TEST(LoadStep, AtTheStepOfAKnownLoadIsNoClaim) {
  const Record plain = record_of(simulate_synthetic({.T_s = 2e-4, .duration_s = 6}));
  std::size_t at = 1;
  const auto step = [&](std::size_t k) { return plain.T_load[k] - plain.T_load[k - 1]; };
  for (std::size_t k = 1; k < plain.size(); ++k)
    if (std::abs(step(k)) > std::abs(step(at))) at = k;
  const double begin_s = plain.t[at], missing_Nm = -0.2 * step(at);
  ASSERT_GT(std::abs(missing_Nm), 0.05);
  const auto of = [&](double delay_s) {
    return traced(record_of(simulate_synthetic(
        {.T_s = 2e-4, .duration_s = 6, .extra_load = [=](double t, double, double) {
           return t < begin_s + delay_s ? 0 : missing_Nm;
         }})));
  };
  const TraceResult together = of(0), apart = of(0.1);
  EXPECT_FALSE(find(together, "load_step")) << together.sentence;
  EXPECT_NE(together.verdict, "nothing_missing");
  const TracedEffect* e = find(apart, "load_step");
  ASSERT_TRUE(e) << apart.sentence;
  EXPECT_NEAR(get_key(*e->effect, "torque_Nm"), missing_Nm, 0.01);
}

TEST(ChangePoints, AZeroOfTheAngleThatJumpsIsAnOffsetFromThenOn) {
  constexpr double kJump_s = 3.1, kJump_rad = 0.02;
  RawLog raw = simulate_synthetic(
      {.T_s = 2e-4, .duration_s = 6, .extra_load = [](double, double theta, double) {
         return cogging(theta);
       }});
  for (std::size_t k = 0; k < raw.size(); ++k)
    if (raw.t[k] >= kJump_s) raw.theta_m[k] += kJump_rad;
  const TraceResult r = traced(record_of(raw));
  ASSERT_EQ(r.changes.size(), 1u) << r.sentence;
  EXPECT_TRUE(r.sentence.starts_with("The zero of theta_m changes at ")) << r.sentence;
  EXPECT_LT(r.changes[0].from_s, kJump_s);
  EXPECT_GT(r.changes[0].to_s, kJump_s);
  const TracedEffect *zero = find(r, "encoder_offset"), *torque = find(r, "cogging");
  ASSERT_TRUE(zero && torque) << r.sentence;
  EXPECT_NEAR(get_key(*zero->effect, "offset_rad"), kJump_rad, 2e-4);
  EXPECT_TRUE(zero->only_in_part);
  EXPECT_NEAR(get_key(*torque->effect, "phase_rad"), 0.5, 0.03);
  EXPECT_FALSE(torque->only_in_part);
}

TEST(ChangePoints, AFileWithAnotherZeroIsThatFilesOffset) {
  Record all;
  std::vector<SourceRows> files;
  for (const char* name : {"a.csv", "b.csv", "c.csv"}) {
    const bool other = name[0] == 'b';
    RawLog raw = simulate_synthetic(
        {.T_s = 4e-4,
         .duration_s = 2,
         .extra_load = [](double, double theta, double) { return cogging(theta); },
         .offset_theta = other ? 0.03 : 0});
    const std::size_t first = all.size();
    all.append(record_of(raw));
    files.push_back({.path = name, .first = first, .end = all.size()});
  }
  const TraceResult r = traced(all, files);
  ASSERT_EQ(r.changes.size(), 2u) << r.sentence;
  EXPECT_EQ(r.changes[0].between, "a.csv and b.csv");
  EXPECT_EQ(r.changes[1].between, "b.csv and c.csv");
  const TracedEffect* zero = find(r, "encoder_offset");
  ASSERT_TRUE(zero) << r.sentence;
  EXPECT_NEAR(get_key(*zero->effect, "offset_rad"), 0.03, 2e-4);
  EXPECT_EQ(zero->files, std::vector<std::string>{"b.csv"});
  EXPECT_FALSE(zero->from_s);
  EXPECT_EQ(r.files.size(), 3u);
}

}  // namespace
}  // namespace twinrate
