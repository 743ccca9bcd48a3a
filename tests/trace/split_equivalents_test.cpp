// An effect split into two equivalents against the fitted one.
#include "trace/split_equivalents.hpp"

#include <gtest/gtest.h>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

TracedEffect traced(const char* kind, const std::vector<std::pair<const char*, double>>& keys) {
  const auto effect = make_effect(kind);
  for (const auto& [key, value] : keys) set_key(*effect, key, value);
  effect->prepare(servo().facts());
  TracedEffect e{.effect = effect, .equation = "electrical"};
  std::map<std::string, double> sigmas;
  for (const auto& [key, value] : keys) sigmas[key] = 0.01 * std::abs(value);
  e.parameters = traced_parameters(*effect, sigmas);
  return e;
}

// Both sides at points of either sign of each phase current.
void expect_same(const Effect& whole, const std::vector<TracedEffect>& parts) {
  for (int j = 0; j < 24; ++j) {
    OperatingPoint p;
    p.theta_e = 0.3 + j * kTwoPi / 24;
    p.i_dq = {1.5 * std::cos(j), 0.4 + 0.2 * j};
    p.v_dc = servo().facts().v_dc;
    Vec2 sum = Vec2::Zero();
    for (const TracedEffect& e : parts) sum += e.effect->at(p).u_dq_drop;
    EXPECT_LT((sum - whole.at(p).u_dq_drop).norm(), 1e-9);
  }
}

TEST(SplitEquivalents, WhatAllPhasesShareIsAResistance) {
  const DriveFacts facts = servo().facts();
  const TracedEffect both = traced(
      "phase_asymmetry", {{"change_a_Ohm", 0.44}, {"change_b_Ohm", 0.16}, {"change_c_Ohm", 0.15}});
  const std::vector<TracedEffect> parts = split_equivalents(both, facts);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[1].effect->kind(), "resistance");
  EXPECT_NEAR(get_key(*parts[1].effect, "change_Ohm"), 0.15, 1e-12);
  EXPECT_NEAR(*parts[1].parameters[0].sigma, 0.0015, 1e-12);
  EXPECT_NEAR(get_key(*parts[0].effect, "change_a_Ohm"), 0.29, 1e-12);
  expect_same(*both.effect, parts);
  // A common part of few deviations is not named: the three changes contain it.
  for (double deviations : {4.0, 6.0}) {
    TracedEffect unsure = both;
    unsure.parameters[2].sigma = 0.15 / deviations;
    EXPECT_EQ(split_equivalents(unsure, facts).size(), deviations < 5 ? 1u : 2u) << deviations;
  }
  // One phase alone, or a common part below the smallest size to report, is not split.
  for (double c : {-0.002, 0.002})
    EXPECT_EQ(split_equivalents(
                  traced("phase_asymmetry",
                         {{"change_a_Ohm", 0.3}, {"change_b_Ohm", 0.003}, {"change_c_Ohm", c}}),
                  facts)
                  .size(),
              1u);
  // What the phases differ by is within its deviation: all of it is a resistance.
  const std::vector<TracedEffect> alike = split_equivalents(
      traced("phase_asymmetry",
             {{"change_a_Ohm", 0.156}, {"change_b_Ohm", 0.15}, {"change_c_Ohm", 0.153}}),
      facts);
  ASSERT_EQ(alike.size(), 1u);
  EXPECT_EQ(alike[0].effect->kind(), "resistance");
}

TEST(SplitEquivalents, AThresholdWithTheSlopeOfAWindingIsADeadTimeAndAResistance) {
  const DriveFacts facts = servo().facts();
  const auto drop = [&](double slope) {
    return traced("inverter_drop",
                  {{"threshold_V", 2.9}, {"resistance_Ohm", slope}, {"linear_current_A", 0.1}});
  };
  const double limit = 0.05 * facts.machine.R_s;
  EXPECT_EQ(split_equivalents(drop(0.98 * limit), facts).size(), 1u);
  const TracedEffect both = drop(1.02 * limit);
  const std::vector<TracedEffect> parts = split_equivalents(both, facts);
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts[0].effect->kind(), "dead_time");
  EXPECT_EQ(parts[0].aliases, std::vector<std::string>{"inverter_drop"});
  EXPECT_NEAR(get_key(*parts[0].effect, "dead_time_s"), 2.9 / (facts.v_dc * facts.f_pwm), 1e-15);
  expect_same(*both.effect, parts);
  // A slope within its uncertainty is none.
  TracedEffect unsure = drop(1.02 * limit);
  for (TracedParameter& p : unsure.parameters)
    if (p.name == "resistance") p.sigma = 0.5 * p.value;
  // Nor is one that was not fitted, which has no sigma.
  TracedEffect not_fitted = unsure;
  for (TracedParameter& p : not_fitted.parameters)
    if (p.name == "resistance") p.sigma.reset();
  for (const TracedEffect& effect : {unsure, not_fitted}) {
    const std::vector<TracedEffect> alone = split_equivalents(effect, facts);
    ASSERT_EQ(alone.size(), 1u);
    EXPECT_EQ(alone[0].effect->kind(), "dead_time");
  }
}

}  // namespace
}  // namespace twinrate
