// Electrical kinds against their closed forms; more in effect_signatures_test.cpp.
#include <gtest/gtest.h>

#include "model/effects/flux_map.hpp"
#include "model/effects/tracing.hpp"
#include "model/random.hpp"
#include "tests/support/effects.hpp"

namespace twinrate::electrical_effects_test {
namespace {

using test::effect_of;

OperatingPoint at_angle(double theta_m, const Vec2& i_dq, double omega_m = 1) {
  return {
      .i_dq = i_dq, .v_dc = 235.4, .omega_m = omega_m, .theta_m = theta_m, .theta_e = 3 * theta_m};
}

// Psi_q in units of L_q I_s, with the linear part of the machine.
double psi_q(int form, double x) {
  const auto effect = make_effect("saturation");
  class Set final : public test::FieldSetter {
   public:
    explicit Set(int form) : FieldSetter({{"current_q_A", 4}}), form_(form) {}
    void choice(const char*, int& index, std::span<const char* const>, const char*) override {
      index = form_;
    }
    int form_;
  } set(form);
  effect->fields(set);
  EXPECT_EQ(effect->prepare(test::drive_facts()), "");
  const Contribution c = effect->at({.i_dq = Vec2(0.3, 4 * x)});
  EXPECT_EQ(c.psi_dq[0], 0);
  return x + c.psi_dq[1] / (0.0127 * 4);
}

TEST(Resistance, DriftsToItsEndAndOpposesTheCurrent) {
  const auto drift = effect_of("resistance", {{"change_Ohm", 0.4}, {"time_constant_s", 5}});
  const auto step = effect_of("resistance", {{"change_Ohm", 0.4}});
  OperatingPoint point = at_angle(0.4, {-1, 2});
  EXPECT_EQ(drift->at(point).u_dq_drop, Vec2(0, 0));
  EXPECT_NEAR((step->at(point).u_dq_drop - Vec2(-0.4, 0.8)).norm(), 0, 1e-15);
  point.t = 5;
  EXPECT_NEAR(drift->at(point).u_dq_drop[1], 0.8 * (1 - std::exp(-1.0)), 1e-15);
  point.t = 500;
  EXPECT_NEAR(drift->at(point).u_dq_drop[1], 0.8, 1e-12);
}

TEST(Resistance, ThatLeavesNoneIsRefusedAsIsFluxAndInductance) {
  const auto refused = [](const char* kind, std::map<std::string, double> values) {
    const auto effect = make_effect(kind);
    test::FieldSetter set(std::move(values));
    effect->fields(set);
    return !effect->prepare(test::drive_facts()).empty();
  };
  EXPECT_TRUE(refused("resistance", {{"change_Ohm", -1.06}}));
  EXPECT_FALSE(refused("resistance", {{"change_Ohm", -1.04}}));
  EXPECT_TRUE(refused("phase_asymmetry", {{"change_b_Ohm", -1.06}}));
  EXPECT_TRUE(refused("flux_linkage", {{"change_Wb", -0.26}}));
  EXPECT_TRUE(refused("inductance", {{"change_q_H", -0.0128}}));
}

TEST(Saturation, FollowsItsLawsAndIsOdd) {
  for (const double x : {0.1, 0.5, 0.79, 2.5}) {
    EXPECT_NEAR(psi_q(0, x), x / (1 + x), 1e-14);
    EXPECT_NEAR(psi_q(2, x), std::tanh(x), 1e-14);
    for (int form = 0; form < 3; ++form) EXPECT_NEAR(psi_q(form, -x), -psi_q(form, x), 1e-15);
  }
  for (const double x : {0.1, 0.5, 0.79}) EXPECT_NEAR(psi_q(1, x), x / (1 + x * x), 1e-14);
  EXPECT_NEAR(psi_q(2, 0.00999), psi_q(2, 0.01001) - 2e-5, 1e-8);  // where its series ends
}

TEST(Saturation, NeverLosesFluxWithCurrentAndHasNoCorner) {
  constexpr double h = 1e-4;
  for (int form = 0; form < 3; ++form) {
    double slope_before = 1;
    for (double x = 0; x < 3; x += 0.01) {
      const double slope = (psi_q(form, x + h) - psi_q(form, x)) / h;
      EXPECT_GT(slope, 0) << form << " " << x;
      EXPECT_LT(slope, slope_before + 1e-6) << form << " " << x;
      EXPECT_GT(slope, slope_before - 0.03) << form << " " << x;
      slope_before = slope;
    }
  }
}

TEST(Saturation, OfNoneHasTheColumnThatSmallSaturationHas) {
  const auto none = effect_of("saturation", {{"current_q_A", 0}});
  const auto little = effect_of("saturation", {{"current_q_A", 1e6}});
  for (const double i_q : {-5.0, 0.4, 3.0}) {
    Contribution start, later;
    none->tracing().regressors({.i_dq = Vec2(1, i_q)}, {&start, 1});
    little->tracing().regressors({.i_dq = Vec2(1, i_q)}, {&later, 1});
    EXPECT_NEAR(start.psi_dq[1], -0.0127 * i_q * std::abs(i_q), 1e-15);
    EXPECT_NEAR(later.psi_dq[1], start.psi_dq[1], 1e-5 * std::abs(start.psi_dq[1]));
    EXPECT_EQ(none->at({.i_dq = Vec2(1, i_q)}).psi_dq, Vec2(0, 0));
  }
}

// Iterated regression from zero saturation converges to the truth.
TEST(Saturation, IsFoundByRegressingOnItsOwnColumnAgainAndAgain) {
  const auto truth = effect_of("saturation", {{"current_q_A", 15.1}});
  const auto fit = effect_of("saturation", {{"current_q_A", 0}});
  for (int round = 0; round < 12; ++round) {
    double xy = 0, xx = 0;
    for (double i_q = -5; i_q <= 5; i_q += 0.25) {
      Contribution column;
      fit->tracing().regressors({.i_dq = Vec2(0, i_q)}, {&column, 1});
      xy += column.psi_dq[1] * truth->at({.i_dq = Vec2(0, i_q)}).psi_dq[1];
      xx += column.psi_dq[1] * column.psi_dq[1];
    }
    const double c = xy / xx;
    fit->tracing().set_coefficients({&c, 1});
  }
  double c = 0;
  fit->tracing().coefficients({&c, 1});
  EXPECT_NEAR(1 / c, 15.1, 1e-4);
}

TEST(CrossSaturation, WeakensTheMagnetsAtLoadInEitherDirection) {
  const auto effect = effect_of("cross_saturation", {{"coefficient_H_A", 2e-4}});
  for (const double i_q : {-3.0, 3.0}) {
    const Vec2 psi = effect->at({.i_dq = Vec2(0.5, i_q)}).psi_dq;
    EXPECT_NEAR(psi[0], -2e-4 / 2 * 9, 1e-18);
    EXPECT_NEAR(psi[1], -2e-4 * 0.5 * i_q, 1e-18);
  }
}

class OnFlux : public testing::TestWithParam<std::string> {};

TEST_P(OnFlux, IsReciprocalAndAFunctionOfTheCurrentsAlone) {
  const auto effect = make_effect(GetParam());
  if (!(effect->acts_on() & kOnFlux)) return;
  test::PlausibleValues set;
  effect->fields(set);
  ASSERT_EQ(effect->prepare(test::drive_facts()), "");
  for (std::uint64_t i = 0; i < 100; ++i) {
    const Vec2 i_dq(normal(2, 0, i), normal(2, 1, i));
    const FluxMap map = flux_map({effect}, {.i_dq = i_dq});
    EXPECT_NEAR(map.slope(0, 1), map.slope(1, 0), 1e-8);
    OperatingPoint elsewhere = at_angle(normal(2, 2, i), i_dq, 100);
    elsewhere.t = 3;
    elsewhere.u_dq = {3, 4};
    EXPECT_EQ(effect->at(elsewhere).psi_dq, map.psi);
  }
}

INSTANTIATE_TEST_SUITE_P(Registry, OnFlux, testing::ValuesIn(effect_kinds()),
                         [](const auto& i) { return i.param; });

TEST(InverterOffset, IsAVectorThatStandsStillAndAddsToWhatIsAskedFor) {
  const auto effect = effect_of("inverter_offset", {{"offset_a_V", 0.3}, {"offset_b_V", -0.1}});
  for (const double theta_m : {0.0, 0.5, 2.0}) {
    const Vec2 gained = inverse_park(-effect->at(at_angle(theta_m, {1, 2})).u_dq_drop, 3 * theta_m);
    EXPECT_NEAR(gained[0], 2.0 / 3 * (0.3 + 0.05), 1e-15);
    EXPECT_NEAR(gained[1], -0.1 / std::sqrt(3.0), 1e-15);
  }
}

TEST(PhaseAsymmetry, OfThreeEqualPhasesIsAResistance) {
  const auto all = effect_of("phase_asymmetry",
                             {{"change_a_Ohm", 0.2}, {"change_b_Ohm", 0.2}, {"change_c_Ohm", 0.2}});
  for (const double theta_m : {0.0, 0.7, 3.0})
    EXPECT_NEAR((all->at(at_angle(theta_m, {-1, 2})).u_dq_drop - 0.2 * Vec2(-1, 2)).norm(), 0,
                1e-14);
}

TEST(PhaseAsymmetry, OfOnePhaseBurnsThatPhasesCurrentSquared) {
  const char* kKeys[] = {"change_a_Ohm", "change_b_Ohm", "change_c_Ohm"};
  for (int phase = 0; phase < 3; ++phase) {
    const auto effect = effect_of("phase_asymmetry", {{kKeys[phase], 0.25}});
    for (const double theta_m : {0.1, 0.9, 2.4}) {
      const OperatingPoint point = at_angle(theta_m, {-1, 2});
      const double i = point.i_abc()[phase];
      EXPECT_NEAR(1.5 * point.i_dq.dot(effect->at(point).u_dq_drop), 0.25 * i * i, 1e-14);
    }
  }
}

TEST(VoltageGain, GivesMoreThanAskedFor) {
  const auto effect = effect_of("voltage_gain", {{"gain", 0.02}});
  EXPECT_NEAR((effect->at({.u_dq = Vec2(-3, 50)}).u_dq_drop - Vec2(0.06, -1)).norm(), 0, 1e-15);
}

TEST(Materiality, IsOneAtTheSmallestElectricalSizesOfAServoMotor) {
  DriveFacts facts = test::drive_facts();
  facts.machine.i_rated = 7;
  facts.machine.omega_m_rated = 104.72;
  const auto of = [&](const char* kind, std::map<std::string, double> values) {
    return effect_of(kind, std::move(values), facts)->tracing().materiality(facts);
  };
  EXPECT_NEAR(of("resistance", {{"change_Ohm", -0.021}}), 1, 1e-12);
  EXPECT_NEAR(of("flux_linkage", {{"change_Wb", -0.006 * 0.2533}}), 1, 1e-12);
  EXPECT_NEAR(of("inductance", {{"change_q_H", 0.015 * 0.0127}}), 1, 1e-12);
  // i/I_s = 0.015/0.985 takes 1.5 % of the flux.
  EXPECT_NEAR(of("saturation", {{"current_q_A", 7 * 0.985 / 0.015}}), 1, 1e-12);
  EXPECT_NEAR(of("current_offset", {{"offset_b_A", -8e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("current_gain", {{"gain_b", -3e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("dead_time", {{"dead_time_s", 1e-7}}), 1, 1e-12);
  EXPECT_NEAR(of("encoder_eccentricity", {{"amplitude_rad", 2e-4}}), 1, 1e-12);
  EXPECT_NEAR(of("encoder_offset", {{"offset_rad", -2e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("voltage_gain", {{"gain", -6e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("phase_asymmetry", {{"change_c_Ohm", 0.021}}), 1, 1e-12);
  EXPECT_NEAR(of("inverter_offset", {{"offset_b_V", -0.05}}), 1, 2e-3);
  EXPECT_NEAR(of("iron_loss", {{"resistance_Ohm", 1500}}), 1, 0.02);
  EXPECT_NEAR(of("flux_harmonics", {{"order", 6}, {"amplitude_Wb", 2.533e-4}}), 1, 1e-12);
  facts.machine.i_rated = 0.7;
  EXPECT_NEAR(of("current_offset", {{"offset_b_A", -8e-3}}), 10, 1e-12);
}

}  // namespace
}  // namespace twinrate::electrical_effects_test
