// Static sets from the laws with additional noise.
#include "trace/static_sets.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "model/random.hpp"
#include "trace/keys.hpp"
#include "trace/measured_result.hpp"
#include "trace/static_split.hpp"

namespace twinrate {
namespace {

DriveFacts facts() {
  return {
      .machine =
          {.R_s = 1.0, .L_d = 0.02, .L_q = 0.1, .psi_f = 0.5, .J = 0.01, .n_p = 2, .i_rated = 15},
      .v_dc = 80,
      .f_pwm = 1e4};
}

std::shared_ptr<Effect> made(const char* kind, const std::map<std::string, double>& keys) {
  auto effect = make_effect(kind);
  for (const auto& [key, value] : keys) EXPECT_TRUE(set_key(*effect, key, value)) << key;
  EXPECT_EQ(effect->prepare(facts()), "");
  return effect;
}

// Phase b, current from -1 to 1 A; the other phases carry half of it each.
StaticSet inverter_curve(const Effects& effects, double R, double noise) {
  StaticSet set{.path = "made"};
  for (int k = 0; k < 240; ++k) {
    const double i = -1 + 2 * k / 239.0;
    const OperatingPoint point{.i_dq = Vec2(i, 0), .v_dc = 80, .theta_e = kTwoPi / 3};
    set.columns["i_b"].push_back(i);
    set.columns["u_b"].push_back(R * i + sum_at(effects, point).u_dq_drop[0] +
                                 noise * normal(5, 0, static_cast<std::uint64_t>(k)));
  }
  return set;
}

TEST(InverterCurve, FindsTheDropAndItsShape) {
  for (int shape = 0; shape < 4; ++shape) {
    const Effects drop{made("inverter_drop",
                            {{"threshold_V", 2.0}, {"linear_current_A", 0.05}, {"shape", shape}})};
    const StaticTrace trace = trace_inverter_curve(inverter_curve(drop, 1.4, 0.01), facts());
    const StaticTerm* found = trace.selection.after.find("inverter_drop");
    ASSERT_NE(found, nullptr);
    EXPECT_EQ(get_key(*found->effect, "shape"), shape);
    const auto& sigma = trace.selection.after.sigma.back();
    EXPECT_NEAR(get_key(*found->effect, "threshold_V"), 2.0, 4 * sigma.at("threshold_V"));
    EXPECT_LT(sigma.at("threshold_V"), 0.02);
    EXPECT_NEAR(get_key(*found->effect, "linear_current_A"), 0.05,
                4 * sigma.at("linear_current_A"));
    EXPECT_NEAR(get_key(*trace.selection.after.terms[0].effect, "change_Ohm"), 0.4, 0.05);
    EXPECT_GT(trace.selection.before.held_out[0], 20 * trace.selection.after.held_out[0]);
    EXPECT_NEAR(trace.selection.after.held_out[0], 0.01, 0.002);
  }
}

TEST(InverterCurve, ReportsDeadTimeAsItsAlias) {
  const Effects drop{made("dead_time", {{"dead_time_s", 2.5e-6}, {"linear_current_A", 0.05}})};
  const StaticSet set = inverter_curve(drop, 1.4, 0.01);
  const StaticTrace trace = trace_inverter_curve(set, facts());
  const StaticTerm* found = trace.selection.after.find("inverter_drop");
  ASSERT_NE(found, nullptr);
  const auto dead_time = equivalent_dead_time(*found->effect, facts());
  ASSERT_NE(dead_time, nullptr);
  EXPECT_NEAR(get_key(*dead_time, "dead_time_s"), 2.5e-6, 0.03e-6);
  const TraceResult result = static_result(set, trace, StaticKind::kInverterCurve);
  EXPECT_EQ(result.verdict, "ambiguous") << "the curve at one bus voltage has two names";
  EXPECT_EQ(result.sentence.find("Ambiguous"), 0u) << result.sentence;
  ASSERT_FALSE(result.ambiguous.empty());
  EXPECT_EQ(result.ambiguous[0].kinds, (std::vector<std::string>{"inverter_drop", "dead_time"}));
}

TEST(InverterCurve, OfAPureResistanceFindsNothingElse) {
  const StaticSet set = inverter_curve({}, 1.01, 0.01);
  const StaticTrace trace = trace_inverter_curve(set, facts());
  EXPECT_EQ(trace.selection.after.find("inverter_drop"), nullptr);
  const TraceResult result = static_result(set, trace, StaticKind::kInverterCurve);
  EXPECT_EQ(result.verdict, "nothing_missing");
  EXPECT_TRUE(result.effects.empty());
}

StaticSet flux_map(const Effects& effects, double noise) {
  StaticSet set{.path = "made"};
  const MachineParameters m = facts().machine;
  std::uint64_t k = 0;
  for (int a = -10; a <= 10; ++a)
    for (int b = -12; b <= 12; ++b, ++k) {
      const Vec2 i_dq(2 * a, 2 * b);
      const Vec2 psi = sum_at(effects, {.i_dq = i_dq}).psi_dq;
      set.columns["i_d"].push_back(i_dq[0]);
      set.columns["i_q"].push_back(i_dq[1]);
      set.columns["psi_d"].push_back(m.psi_f + m.L_d * i_dq[0] + psi[0] + noise * normal(6, 0, k));
      set.columns["psi_q"].push_back(m.L_q * i_dq[1] + psi[1] + noise * normal(6, 1, k));
    }
  return set;
}

TEST(FluxMap, NamesSaturationAndCrossSaturation) {
  const Effects iron{made("saturation", {{"form", 2}, {"current_q_A", 8.0}, {"share_q", 0.8}}),
                     made("cross_saturation", {{"coefficient_H_A", 2e-4}})};
  const StaticSet set = flux_map(iron, 1e-3);
  const StaticTrace trace = trace_flux_map(set, facts());
  const StaticFit& after = trace.selection.after;
  ASSERT_NE(after.find("saturation"), nullptr);
  ASSERT_NE(after.find("cross_saturation"), nullptr);
  EXPECT_EQ(get_key(*after.find("saturation")->effect, "form"), 2);
  EXPECT_NEAR(get_key(*after.find("saturation")->effect, "current_q_A"), 8.0, 0.2);
  EXPECT_NEAR(after.held_out[0], 1e-3, 3e-4);
  EXPECT_NEAR(after.held_out[1], 1e-3, 3e-4);
  EXPECT_GT(trace.selection.before.held_out[1], 8 * after.held_out[1]);
  const TraceResult result = static_result(set, trace, StaticKind::kFluxMap);
  EXPECT_EQ(result.verdict, "traced");
  EXPECT_EQ(result.electrical->unit, "Wb");
}

TEST(FluxMap, StoppedAfterAStepTellsOnlyWhatPassesTheGate) {
  const Effects iron{made("saturation", {{"form", 2}, {"current_q_A", 8.0}, {"share_q", 0.8}}),
                     made("cross_saturation", {{"coefficient_H_A", 2e-4}})};
  const StaticSet set = flux_map(iron, 1e-3);
  int steps = 0;
  const TraceHooks after_one{.say = [&](const std::string&) { ++steps; },
                             .stop = [&] { return steps > 0; }};
  const StaticTrace trace = trace_flux_map(set, facts(), {}, after_one);
  EXPECT_TRUE(trace.selection.interrupted);
  ASSERT_EQ(trace.selection.steps.size(), 1u);
  const TraceResult result = static_result(set, trace, StaticKind::kFluxMap);
  EXPECT_TRUE(result.interrupted);
  EXPECT_EQ(result.sentence.find("Interrupted after 1 step of"), 0u) << result.sentence;
  // What the missing second effect leaves is as large: the first is refused, and not told.
  const std::string& kind = trace.selection.steps[0].kind;
  const auto refused = [&](const Refused& x) { return x.kind == kind; };
  EXPECT_TRUE(std::any_of(result.refused.begin(), result.refused.end(), refused));
  for (const TracedEffect& e : result.effects) {
    EXPECT_NE(e.effect->kind(), kind);
    EXPECT_GT(e.held_out_gain, 0) << "interrupted or not, what is told passed the gate";
  }

  EXPECT_THROW(trace_flux_map(set, facts(), {}, {.say = {}, .stop = [] { return true; }}),
               TraceStopped);
}

TEST(FluxMap, OfConstantInductancesFindsNothing) {
  const StaticTrace trace = trace_flux_map(flux_map({}, 1e-3), facts());
  EXPECT_TRUE(trace.selection.steps.empty());
  EXPECT_NEAR(trace.selection.after.held_out[1], 1e-3, 2e-4);
}

TEST(HeldOut, OfTheBoardOrTheLineAFourthJudgesAndAFourthChooses) {
  const std::vector<double> x{0, 0, 0, 1, 1, 1}, y{5, 6, 7, 5, 6, 7};
  StaticProblem p;
  split_points({.path = "made", .columns = {}}, x, y, {}, "", p);
  using enum PointRole;
  EXPECT_EQ(p.role, (std::vector<PointRole>{kFits, kJudges, kFits, kChooses, kFits, kChooses}));
  split_points({.path = "made", .columns = {}}, {3, 1, 2, 0}, {}, {}, "", p);
  EXPECT_EQ(p.role, (std::vector<PointRole>{kChooses, kJudges, kFits, kFits}));
}

TEST(KindOfSet, FollowsTheColumns) {
  const auto with = [](std::initializer_list<const char*> names) {
    StaticSet set;
    for (const char* name : names) set.columns[name] = {1};
    return kind_of(set);
  };
  EXPECT_EQ(with({"i_d", "i_q", "psi_d", "psi_q"}), StaticKind::kFluxMap);
  EXPECT_EQ(with({"i_c", "u_c"}), StaticKind::kInverterCurve);
  EXPECT_EQ(with({"theta_m", "i_q"}), StaticKind::kHoldingCurrent);
  EXPECT_EQ(with({"i_c", "u_b"}), StaticKind::kNone);
}

// The first reading of a curve that is no machine's: a law that no kind has is not named.
TEST(StaticGate, WhatNoKindDescribesIsUnexplained) {
  for (int which = 0; which < 3; ++which) {
    StaticSet set = inverter_curve({}, 1.0, 0.005);
    for (std::size_t k = 0; k < set.size(); ++k) {
      const double i = set.columns["i_b"][k];
      const double unknown[] = {0.4, 0.4 * i * i, i > 0.3 ? 0.4 : 0};
      set.columns["u_b"][k] += unknown[which];
    }
    const TraceResult r =
        static_result(set, trace_inverter_curve(set, facts()), StaticKind::kInverterCurve);
    EXPECT_EQ(r.verdict, "unexplained") << which << ": " << r.sentence;
    EXPECT_TRUE(r.effects.empty()) << which << ": " << r.sentence;
    EXPECT_EQ(r.sentence.find("Unexplained"), 0u) << r.sentence;
  }
}

// Points that judge say nothing of what is fitted and chosen.
TEST(StaticGate, RefusesWhatPointsThatJudgeDoNotShow) {
  const Effects drop{made("inverter_drop", {{"threshold_V", 2.0}, {"linear_current_A", 0.05}})};
  StaticSet set = inverter_curve(drop, 1.0, 0.01);
  const StaticSet plain = inverter_curve({}, 1.0, 0.01);
  for (std::size_t k = 1; k < set.size(); k += 4)
    set.columns["u_b"][k] = plain.columns.at("u_b")[k];
  const StaticTrace trace = trace_inverter_curve(set, facts());
  const TraceResult r = static_result(set, trace, StaticKind::kInverterCurve);
  EXPECT_TRUE(r.effects.empty()) << r.sentence;
  EXPECT_NE(r.verdict, "nothing_missing") << r.sentence;
  ASSERT_FALSE(r.refused.empty());
  EXPECT_EQ(r.sentence.find("falls from"), std::string::npos) << r.sentence;
}

TEST(StaticGate, EveryFileHasALine) {
  StaticSet set = inverter_curve({}, 1.4, 0.01);
  set.files = {"one", "two"};
  for (std::size_t k = 0; k < set.size(); ++k) set.file.push_back(k % 2 == 1);
  const TraceResult r =
      static_result(set, trace_inverter_curve(set, facts()), StaticKind::kInverterCurve);
  ASSERT_EQ(r.files.size(), 2u);
  EXPECT_EQ(r.files[1].path, "two");
  EXPECT_EQ(r.files[0].rows, 120u);
  EXPECT_GT(r.files[0].before, 10 * r.files[0].after);
  EXPECT_NEAR(r.files[0].noise, 0.01, 0.002);
}

// Points held out that say something else: the fit does not know them.
TEST(HeldOut, ItsErrorIsThatOfThePointsHeldOut) {
  StaticSet set = inverter_curve({}, 1.4, 0.01);
  std::vector<char> held(set.size());
  for (std::size_t k = 0; k < held.size(); ++k) held[k] = k % 2;
  const StaticTrace plain = trace_inverter_curve(set, facts(), held);
  for (std::size_t k = 0; k < held.size(); ++k)
    if (held[k]) set.columns["u_b"][k] += k % 4 < 2 ? 0.3 : -0.3;
  const StaticTrace spoilt = trace_inverter_curve(set, facts(), held);
  EXPECT_NEAR(plain.selection.after.held_out[0], 0.01, 0.003);
  EXPECT_NEAR(spoilt.selection.after.held_out[0], 0.3, 0.03);
  EXPECT_NEAR(spoilt.selection.after.train[0], 0.01, 0.003);
}

}  // namespace
}  // namespace twinrate
