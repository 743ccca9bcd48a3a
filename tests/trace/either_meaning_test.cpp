#include "trace/either_meaning.hpp"

#include <gtest/gtest.h>

#include "model/effects/effect.hpp"

namespace twinrate {
namespace {

TracedEffect resistance(double change_Ohm, double sigma) {
  TracedEffect e{.effect = make_effect("resistance"), .equation = "electrical"};
  e.parameters = {{.name = "change", .unit = "Ohm", .value = change_Ohm, .sigma = sigma}};
  e.materiality = 10 * change_Ohm;
  return e;
}

// Errors of the judging rows in V.
TraceResult of_voltage(std::vector<TracedEffect> effects, double after_V = 0.1,
                       double noise_V = 0.1) {
  TraceResult r;
  r.verdict = "traced";
  r.effects = std::move(effects);
  r.identifiable = {"dead_time", "inductance"};
  r.electrical = EquationError{.unit = "V",
                               .before = {},
                               .after = {.train = 0, .held_out = after_V},
                               .noise_floor = noise_V};
  return r;
}

TraceResult with_structure(double after_V) {
  TraceResult r = of_voltage({resistance(0.2, 0.01)}, after_V);
  r.verdict = "unexplained";
  r.unexplained = {{.regressor = "omega_m", .equation = "electrical"}};
  return r;
}

TEST(EitherMeaning, TheDifferenceOfTheTwoIsTheUncertainty) {
  const auto r =
      shown_by_both(of_voltage({resistance(0.2, 0.001)}), of_voltage({resistance(0.23, 0.001)}));
  ASSERT_TRUE(r);
  EXPECT_DOUBLE_EQ(r->effects.at(0).parameters.at(0).value, 0.2);
  EXPECT_NEAR(*r->effects.at(0).parameters.at(0).sigma, 0.03, 1e-12);
}

TEST(EitherMeaning, AnEffectOfOneOrOfAnotherSizeIsNotShown) {
  const TraceResult one = of_voltage({resistance(0.2, 0.001)});
  EXPECT_FALSE(shown_by_both(one, of_voltage({})));
  EXPECT_FALSE(shown_by_both(one, of_voltage({resistance(0.41, 0.001)})));
  EXPECT_FALSE(shown_by_both(one, with_structure(0.1)));
  TraceResult other = of_voltage({resistance(0.2, 0.001)});
  other.effects[0].effect = make_effect("inverter_drop");
  EXPECT_FALSE(shown_by_both(one, other));
}

TEST(EitherMeaning, TheVoltageIsOfNoUseToATorque) {
  TraceResult one = of_voltage({resistance(0.2, 0.001)});
  one.effects[0].equation = "mechanical";
  EXPECT_FALSE(shown_by_both(one, one));
  EXPECT_FALSE(explains_alone(one, with_structure(0.5)));
}

TEST(EitherMeaning, TheLongerListOfAliasesStands) {
  TraceResult one = of_voltage({resistance(0.2, 0.001)}), other = one;
  other.effects[0].aliases = {"inverter_drop"};
  other.verdict = "ambiguous";
  for (const auto& r : {shown_by_both(one, other), shown_by_both(other, one)}) {
    ASSERT_TRUE(r);
    EXPECT_EQ(r->verdict, "ambiguous");
  }
}

TEST(EitherMeaning, AKindIsIdentifiableIfBothSaySo) {
  TraceResult one = of_voltage({resistance(0.2, 0.001)}), other = one;
  other.identifiable = {"dead_time"};
  const auto r = shown_by_both(one, other);
  ASSERT_TRUE(r);
  EXPECT_EQ(r->identifiable, std::vector<std::string>{"dead_time"});
  EXPECT_EQ(r->not_identifiable.at(0).first, "inductance");
}

// It would be there with any voltage.
TEST(EitherMeaning, AStructureOfTheTorqueStaysBesideTheEffectsOfTheVoltage) {
  const TraceResult clean = of_voltage({resistance(0.2, 0.001)});
  TraceResult torque = with_structure(0.1);
  torque.unexplained[0].equation = "mechanical";
  for (const auto& r : {shown_by_both(torque, torque), shown_by_both(torque, clean),
                        shown_by_both(clean, torque)}) {
    ASSERT_TRUE(r);
    EXPECT_EQ(r->verdict, "unexplained");
    EXPECT_EQ(r->effects.size(), 1u);
  }
  EXPECT_FALSE(explains_alone(torque, with_structure(0.5)));
  TraceResult refused = torque;
  refused.refused.push_back({.kind = "saturation"});
  EXPECT_FALSE(shown_by_both(torque, refused));
}

// The noise of 0.1 V is subtracted from the errors.
TEST(EitherMeaning, OneExplainsIfTheOtherLeavesMoreThanNoise) {
  const TraceResult one = of_voltage({resistance(0.2, 0.001)}, 0.101);
  EXPECT_TRUE(explains_alone(one, with_structure(0.11)));
  EXPECT_FALSE(explains_alone(one, with_structure(0.1015)));
  EXPECT_FALSE(explains_alone(with_structure(0.101), with_structure(0.11)));
  EXPECT_FALSE(explains_alone(one, of_voltage({resistance(0.2, 0.001)}, 0.11)));
}

}  // namespace
}  // namespace twinrate
