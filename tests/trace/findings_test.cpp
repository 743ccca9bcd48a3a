// The search once more without kinds that the gate refused as another than what is there.
#include "trace/findings.hpp"

#include <gtest/gtest.h>

#include "tests/trace/fitted_drive.hpp"
#include "trace/vote.hpp"

namespace twinrate::findings_test {

Findings findings(std::size_t passed, std::vector<Refused> refused) {
  Findings f;
  for (std::size_t m = 0; m < passed; ++m) f.passed.kept.push_back(m);
  f.passed.refused = std::move(refused);
  return f;
}

Refused refused(const char* kind, bool wrong) {
  return {.kind = kind, .rule = wrong ? "physical" : "transfer", .wrong_kind = wrong};
}

// What was searched again without, what was compared, and what is told in the end.
struct Again {
  Again(Findings first, Findings second, bool explains_as_much) {
    result = without_wrong_kinds(
        std::move(first),
        [&](const Fit&, const std::vector<std::string>& kinds) {
          left_out = kinds;
          return second;
        },
        [&](const Findings&, const Findings&) {
          compared = true;
          return explains_as_much;
        });
  }
  Findings result;
  std::vector<std::string> left_out;
  bool compared = false;
};

std::vector<std::string> kinds_of(const std::vector<Refused>& list) {
  std::vector<std::string> kinds;
  kinds.reserve(list.size());
  for (const Refused& r : list) kinds.push_back(r.kind);
  return kinds;
}

TEST(Findings, AreSearchedAgainWithoutWrongKindsAlone) {
  const Findings first = findings(1, {refused("saturation", false)});
  EXPECT_TRUE(Again(first, findings(5, {}), true).left_out.empty());
  const Again again(findings(1, {refused("saturation", false), refused("inertia", true)}),
                    findings(2, {refused("cogging", false)}), true);
  EXPECT_EQ(again.left_out, std::vector<std::string>{"inertia"});
  EXPECT_EQ(again.result.passed.kept.size(), 2u);
  // What the first search refused stays told.
  EXPECT_EQ(kinds_of(again.result.passed.refused),
            (std::vector<std::string>{"saturation", "inertia", "cogging"}));
}

TEST(Findings, OfASecondSearchMustBeMoreAndExplainAsMuch) {
  const Findings first = findings(1, {refused("inertia", true)});
  const Again no_more(first, findings(1, {refused("cogging", false)}), true);
  EXPECT_FALSE(no_more.compared);
  EXPECT_EQ(kinds_of(no_more.result.passed.refused), std::vector<std::string>{"inertia"});
  const Again less(first, findings(2, {}), false);
  EXPECT_TRUE(less.compared);
  EXPECT_EQ(less.result.passed.kept.size(), 1u);
}

TEST(Findings, NoOtherNamesAreThoseThatNoMachineCanHaveSoLarge) {
  const std::vector<Refused> list = {{.kind = "inertia", .rule = "physical", .wrong_kind = true},
                                     {.kind = "dead_time", .rule = "size", .wrong_kind = true},
                                     {.kind = "cogging", .rule = "transfer", .wrong_kind = false}};
  EXPECT_EQ(wrong_kinds(list), (std::vector<std::string>{"inertia", "dead_time"}));
  EXPECT_EQ(impossible_kinds(list), std::vector<std::string>{"inertia"});
}

// A resistance of 0.3 Ohm too much: the residual holds it along what the model with it changes. Along
// the opposite change it holds nothing.
TEST(Vote, WhatTheRowsHoldAlongAClaimHasItsSign) {
  SyntheticDrive drive{.duration_s = 2, .R_extra = 0.3};
  const Members truth = {effect_with("resistance", {{"change_Ohm", 0.3}})},
                opposite = {effect_with("resistance", {{"change_Ohm", -0.3}})};
  const FittedDrive fitted(simulate_synthetic(drive), truth);
  const Chain& chain = fitted.chain();
  const JudgedFiles files;
  const JudgingRows judging(chain, files);
  const auto left = [&](const Members& members) {
    return chain.whitened(chain.residual({members.begin(), members.end()}));
  };
  const std::vector<Channel> voltages = {&Sampled::d, &Sampled::q};
  EXPECT_GT(along_beside_noise(judging, left(truth), left({}), voltages), 100);
  EXPECT_EQ(along_beside_noise(judging, left(opposite), left({}), voltages), 0);
}

}  // namespace twinrate::findings_test
