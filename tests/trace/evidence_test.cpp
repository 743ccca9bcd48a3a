// Kinds that explain the same as what was found, from what they gain.
#include "trace/evidence.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/trace/fitted_drive.hpp"
#include "tests/trace/traced_drive.hpp"

namespace twinrate::evidence_test {

Members cogging_17() {
  return {effect_with("cogging", {{"order", 17.}, {"amplitude_Nm", 0.1}, {"phase_rad", 0.8}})};
}

class Aliases : public ::testing::Test {
 protected:
  Aliases() : drive_(simulate_synthetic(with_cogging()), cogging_17()) {}

  static SyntheticDrive with_cogging() {
    SyntheticDrive drive{.duration_s = 3};
    drive.extra_load = [](double, double theta, double) {
      return 0.1 * std::sin(17 * theta + 0.8);
    };
    return drive;
  }

  // Of a claim with that gain, beside another kind.
  std::vector<std::string> of(double gain, const Alternative& other,
                              double margin = Fitter::kMargin, bool lag_is_open = false) {
    Fitter fitter = drive_.fitter();
    fitter.set_margin(margin);
    Selected selected{.without = fitter.start({}), .score_gain = gain, .held_out_gain = 0.99};
    selected.alternatives = {other, other};  // delay and filter are one kind
    return traced_effect(fitter, fitter.refine(cogging_17()), selected, 0, lag_is_open).aliases;
  }
  static Alternative other(double score_gain, double held_out_gain = 0.5) {
    return {"flux_harmonics", score_gain, held_out_gain, kExplainsLess, 3};
  }

  FittedDrive drive_;
};

// What is left of a faint effect is not all noise: 15 % of its gain, 300 at most, may be chance.
TEST_F(Aliases, WhatMayBeChanceDoesNotShrinkWithTheGain) {
  for (const double gain : {1900., 2100., 10000.})
    for (const auto& [less, count] : {std::pair(280., 1u), std::pair(320., 0u)})
      EXPECT_EQ(of(gain, other(gain - less)).size(), count) << gain << " less " << less;
}

// The errors of a coarse converter are no noise: where they ask ten times the margin, they may decide
// between two kinds by ten times as much.
TEST_F(Aliases, AsTheMarginGrowsWhatDecidesHasToBeMore) {
  for (const auto& [less, count] : {std::pair(2800., 1u), std::pair(3200., 0u)}) {
    EXPECT_EQ(of(25000, other(25000 - less), 10 * Fitter::kMargin).size(), count) << less;
    EXPECT_TRUE(of(25000, other(25000 - less)).empty()) << less;
  }
}

// A model with faults that nobody named does not decide between kinds that explain 99 % of each other.
TEST_F(Aliases, InAFaultyModelAreThoseThatExplainTheSameEnergy) {
  EXPECT_TRUE(of(50000, other(48000, 0.985)).empty());
  drive_.scale_noise(0.5);
  EXPECT_EQ(of(50000, other(48000, 0.985)).size(), 1u);
  EXPECT_TRUE(of(50000, other(48000, 0.975)).empty());
}

TEST_F(Aliases, ALagThatCannotBeTracedIsOneOfWhatItMostlyExplains) {
  const auto alias = [&](const char* kind, double share, bool open) {
    Alternative one = other(share * 50000);
    one.kind = kind;
    return of(50000, one, Fitter::kMargin, open).size();
  };
  for (const char* kind : {"signal_lag", "encoder_offset"}) {
    EXPECT_EQ(alias(kind, 0.81, true), 1u) << kind;
    EXPECT_EQ(alias(kind, 0.79, true), 0u) << kind;
    EXPECT_EQ(alias(kind, 0.81, false), 0u) << kind;
  }
  EXPECT_EQ(alias("flux_harmonics", 0.81, true), 0u);
}

// A refinement that leaves the bounds of a kind is not reported; the fit where it began is.
TEST_F(Aliases, AFitThatIsNotRefinedHasItsDeviations) {
  const Fitter fitter = drive_.fitter();
  TracedEffect began, refined;
  take_parameters(fitter, fitter.linearised(cogging_17()), 0, began);
  take_parameters(fitter, fitter.refine(cogging_17()), 0, refined);
  for (std::size_t p = 0; p < began.parameters.size(); ++p) {
    if (began.parameters[p].name != "amplitude") continue;
    ASSERT_GT(began.parameters[p].sigma.value_or(0), 0);
    EXPECT_NEAR(*began.parameters[p].sigma / *refined.parameters[p].sigma, 1, 0.05);
    return;
  }
  FAIL() << "no amplitude";
}

// At one speed and load a delay of the angle is an error of two voltages, which an inductance has as
// well, and the rounding of the counts repeats: it decides nothing between them.
TEST(AliasesAtConstantSpeed, WhatADelayOfTheAngleMostlyExplainsMayBeIt) {
  constexpr double kLag_s = 0.77e-4, kCell = kTwoPi / 16384;
  RawLog raw = simulate_synthetic({.duration_s = 3, .held = true, .counts = 1 << 26});
  const std::vector<double> theta = raw.theta_m;
  for (std::size_t k = 1; k < raw.size(); ++k) {
    const double late = theta[k] - kLag_s / SyntheticDrive{}.T_s * wrap_pi(theta[k] - theta[k - 1]);
    raw.theta_m[k] = kCell * std::floor(late / kCell);
  }
  const TraceResult r = trace_of(raw);
  ASSERT_EQ(r.effects.size(), 1u) << r.sentence;
  EXPECT_EQ(r.verdict, "ambiguous") << r.sentence;
  Names group = r.effects[0].aliases;
  group.emplace_back(r.effects[0].effect->kind());
  for (const char* kind : {"signal_lag", "encoder_offset", "inductance"})
    EXPECT_EQ(std::count(group.begin(), group.end(), kind), 1) << kind;
}

}  // namespace twinrate::evidence_test
