#include "tests/support/effects.hpp"

#include <gtest/gtest.h>

#include "model/effects/memory.hpp"
#include "model/effects/tracing.hpp"
#include "model/random.hpp"

namespace twinrate {
namespace {

std::shared_ptr<Effect> cogging(int order, double amplitude, double phase) {
  return test::effect_of("cogging",
                         {{"order", order}, {"amplitude_Nm", amplitude}, {"phase_rad", phase}});
}

std::shared_ptr<Effect> coulomb(double torque, double smooth) {
  return test::effect_of("coulomb_friction", {{"torque_Nm", torque}, {"smooth_rad_s", smooth}});
}

OperatingPoint random_point(std::uint64_t index) {
  OperatingPoint point{.t = uniform(1, 0, index),
                       .i_dq = Vec2(normal(1, 1, index), normal(1, 2, index)),
                       .u_dq = Vec2(20 * normal(1, 5, index), 20 * normal(1, 6, index)),
                       .v_dc = 235.4,
                       .omega_m = 0.05 * normal(1, 3, index),  // where a smoothed sign is not +-1
                       .theta_m = 100 * normal(1, 4, index)};
  point.theta_e = 3 * point.theta_m;
  return point;
}

std::shared_ptr<Effect> plausible(const std::string& kind) {
  const auto effect = make_effect(kind);
  test::PlausibleValues set;
  effect->fields(set);
  EXPECT_EQ(effect->prepare(test::drive_facts()), "");
  return effect;
}

// Some milliseconds of motion that end at random_point(index), except for the angle.
std::vector<OperatingPoint> random_record(std::uint64_t index) {
  std::vector<OperatingPoint> record;
  double theta_m = normal(1, 4, index);
  for (int k = 0; k < 100; ++k) {
    OperatingPoint point = random_point(100 * index + static_cast<std::uint64_t>(k));
    point.t = 0.6 + 1e-4 * k;
    point.omega_m = 30 * std::sin(0.3 * k);
    point.theta_m = theta_m += 1e-4 * point.omega_m;
    point.theta_e = 3 * theta_m;
    point.T_load = 0.5;
    record.push_back(point);
  }
  return record;
}

// Contribution of an effect at the end of that record.
Contribution contribution(const Effect& effect, std::uint64_t index) {
  const auto record = random_record(index);
  std::vector<Contribution> sums(record.size());
  contributions(effect, record, 1e-4, sums);
  return sums.back();
}

// Late, repeated and lost rows contribute to no equation.
bool adds_something(const Effect& effect) {
  return effect.acts_on() != 0;
}

// Requirements on every effect of the registry.
class EveryEffect : public testing::TestWithParam<std::string> {};

TEST_P(EveryEffect, IsTheSumOfItsCoefficientsTimesItsRegressors) {
  const auto effect = plausible(GetParam());
  const auto count = static_cast<std::size_t>(effect->tracing().regressor_count());
  if (count == 0) GTEST_SKIP() << "no regressors: it has a memory, or shows in the raw samples";
  std::vector<double> coefficients(count);
  effect->tracing().coefficients(coefficients);
  double size = 0;
  for (std::uint64_t i = 0; i < 500; ++i) {
    const OperatingPoint point = random_point(i);
    std::vector<Contribution> columns(count);
    effect->tracing().regressors(point, columns);
    test::Flat sum = test::Flat::Zero();
    for (std::size_t c = 0; c < count; ++c) sum += coefficients[c] * test::flat(columns[c]);
    const auto whole = test::flat(effect->at(point));
    EXPECT_NEAR((whole - sum).norm(), 0, 1e-12 * (1 + whole.norm()));
    size = std::max(size, whole.norm());
  }
  EXPECT_GT(size, 1e-3);
}

// A point with the axis precomputed by the tracer equals a point without it.
TEST_P(EveryEffect, IsTheSameWithAPrecomputedAxis) {
  const auto effect = plausible(GetParam());
  std::vector<OperatingPoint> record = random_record(3), with_axis = record;
  for (OperatingPoint& point : with_axis)
    point.d_axis = Vec2(std::cos(point.theta_e), std::sin(point.theta_e));
  std::vector<Contribution> sums(record.size()), sums_with_axis(record.size());
  contributions(*effect, record, 1e-4, sums);
  contributions(*effect, with_axis, 1e-4, sums_with_axis);
  for (std::size_t k = 0; k < record.size(); ++k) {
    const auto whole = test::flat(sums[k]);
    EXPECT_NEAR((test::flat(sums_with_axis[k]) - whole).norm(), 0, 1e-12 * (1 + whole.norm()));
  }
}

TEST_P(EveryEffect, TakesItsCoefficientsBack) {
  const auto effect = plausible(GetParam());
  if (effect->tracing().traced_keys().empty()) GTEST_SKIP() << "the tracer has no fit for it";
  const auto count = static_cast<std::size_t>(effect->tracing().regressor_count());
  std::vector<double> given(count), kept(count);
  effect->tracing().coefficients(given);
  for (double& coefficient : given) coefficient *= 0.7;
  const auto copy = effect->clone();
  copy->tracing().set_coefficients(given);
  copy->tracing().coefficients(kept);
  for (std::size_t i = 0; i < count; ++i)
    EXPECT_NEAR(kept[i], given[i], 1e-12 * (1 + std::abs(given[i])));
}

TEST_P(EveryEffect, TwiceItsSizeHasMoreMateriality) {
  const auto effect = plausible(GetParam());
  if (effect->tracing().traced_keys().empty() || effect->tracing().regressor_count() == 0)
    GTEST_SKIP() << "the tracer has no fit for it";
  const auto facts = test::drive_facts();
  std::vector<double> c(static_cast<std::size_t>(effect->tracing().regressor_count()));
  effect->tracing().coefficients(c);
  const double size = effect->tracing().materiality(facts);
  EXPECT_GT(size, 0);
  for (double& coefficient : c) coefficient *= 2;
  effect->tracing().set_coefficients(c);
  EXPECT_LT(effect->tracing().materiality(facts), 2.000001 * size);
  // The materiality of extreme saturation is limited.
  EXPECT_GT(effect->tracing().materiality(facts),
            (GetParam() == "saturation" ? 1.01 : 1.999999) * size);
}

TEST_P(EveryEffect, ChangesOnlyTheSignalsThatItDeclares) {
  const auto effect = plausible(GetParam());
  int touched = 0;
  for (std::uint64_t i = 0; i < 50; ++i) {
    touched |= test::touched(contribution(*effect, i));
    touched |= test::touched(effect->at(random_point(i)));
  }
  EXPECT_EQ(touched, effect->acts_on());
}

TEST_P(EveryEffect, DeclaresItsFieldsAndItsNeeds) {
  const auto effect = make_effect(GetParam());
  EXPECT_EQ(effect->kind(), GetParam());
  EXPECT_FALSE(effect->meaning().empty());
  EXPECT_FALSE(effect->tracing().signals_needed().empty());
  test::FieldSetter look;
  effect->fields(look);
  EXPECT_FALSE(look.required().empty()) << "an effect without a size says nothing";
  EXPECT_TRUE(look.in_range()) << "a default lies outside its own range";
}

TEST_P(EveryEffect, ACloneIsItsOwnObjectWithTheSameValues) {
  const auto effect = plausible(GetParam());
  const auto copy = effect->clone();
  EXPECT_EQ(test::flat(contribution(*copy, 7)), test::flat(contribution(*effect, 7)));
  test::Silence silence;
  copy->fields(silence);
  EXPECT_TRUE(test::flat(contribution(*copy, 7)).isZero(0));
  if (adds_something(*effect)) {
    EXPECT_FALSE(test::flat(contribution(*effect, 7)).isZero(0));
  }
}

// A visitor that finds a number or a choice by name, with its value and range.
class Meet final : public test::FieldSetter {
 public:
  explicit Meet(std::string key) : key_(std::move(key)) {}
  void number(const char* key, double& value, double lo, double hi, const char*,
              Presence) override {
    if (key == key_) met = true, min = lo, max = hi, held = value;
  }
  void integer(const char* key, int& value, int lo, int hi, const char*, Presence) override {
    if (key == key_) met = true, min = lo, max = hi, held = value;
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char*) override {
    if (key == key_) met = true, max = static_cast<double>(names.size()) - 1, held = index;
  }
  bool met = false;
  double min = 0, max = 0, held = 0;

 private:
  std::string key_;
};

TEST_P(EveryEffect, TracesKeysThatItHasOnGridsInsideTheirRange) {
  const auto effect = plausible(GetParam());
  int linear = 0;
  for (const TracedKey& traced : effect->tracing().traced_keys()) {
    Meet meet(traced.key);
    effect->fields(meet);
    EXPECT_TRUE(meet.met) << traced.key;
    for (const double value : traced.grid) {
      EXPECT_GE(value, meet.min) << traced.key;
      EXPECT_LE(value, meet.max) << traced.key;
    }
    linear += traced.linear;
  }
  EXPECT_LE(linear, 3);
}

TEST_P(EveryEffect, HasMaterialityOnlyIfItsSizeIsNotZero) {
  const auto effect = plausible(GetParam());
  if (effect->tracing().traced_keys().empty()) return;
  const DriveFacts facts = test::drive_facts();
  EXPECT_GT(effect->tracing().materiality(facts), 0.4);  // the plausible values are large
  test::Silence silence;
  effect->fields(silence);
  EXPECT_EQ(effect->prepare(facts), "");
  EXPECT_EQ(effect->tracing().materiality(facts), 0);
}

INSTANTIATE_TEST_SUITE_P(Registry, EveryEffect, testing::ValuesIn(effect_kinds()),
                         [](const auto& i) { return i.param; });

TEST(EffectRegistry, AnUnknownKindIsNull) {
  EXPECT_EQ(make_effect("perpetuum_mobile"), nullptr);
}

// Smallest sizes to report on the reference drive, and on a drive with a tenth of its torque.
TEST(Materiality, IsOneAtTheSmallestSizeOfAServoMotor) {
  DriveFacts facts = test::drive_facts();
  facts.machine.T_rated = 8.1;
  facts.machine.omega_m_rated = 100;
  const auto of = [&](const char* kind, std::map<std::string, double> values) {
    return test::effect_of(kind, std::move(values), facts)->tracing().materiality(facts);
  };
  EXPECT_NEAR(of("cogging", {{"order", 6}, {"amplitude_Nm", 4e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("constant_load", {{"torque_Nm", -10e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("coulomb_friction", {{"torque_Nm", 10e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("stribeck_friction", {{"torque_Nm", 20e-3}, {"speed_rad_s", 1}}), 1, 1e-12);
  EXPECT_NEAR(of("load_step", {{"torque_Nm", -20e-3}, {"time_s", 1}}), 1, 1e-12);
  EXPECT_NEAR(of("inertia", {{"change_kgm2", -0.02 * 8.8e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("eccentric_load", {{"amplitude_Nm", 8e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("friction_ripple", {{"order", 1}, {"amplitude_Nm", 8e-3}}), 1, 1e-12);
  EXPECT_NEAR(of("fan_load", {{"coefficient_Nms2", 15e-7}}), 1, 1e-12);
  EXPECT_NEAR(of("viscous_friction", {{"coefficient_Nms", 15e-5}}), 1, 1e-12);
  facts.machine.T_rated = 0.81;
  EXPECT_NEAR(of("cogging", {{"order", 6}, {"amplitude_Nm", 4e-3}}), 10, 1e-12);
}

TEST(Cogging, OpposesPositiveMotionWithAmplitudeSinOrderThetaPlusPhase) {
  // docs/conventions.md: torques add to T_load, cogging +amplitude sin(order theta_m + phase).
  const auto effect = cogging(6, 0.02, 0.4);
  EXPECT_NEAR(effect->at({.theta_m = 0}).T_load, 0.02 * std::sin(0.4), 1e-15);
  EXPECT_NEAR(effect->at({.theta_m = (kPi / 2 - 0.4) / 6}).T_load, 0.02, 1e-15);
  EXPECT_NEAR(effect->at({.theta_m = (-kPi / 2 - 0.4) / 6}).T_load, -0.02, 1e-15);
  EXPECT_EQ(effect->at({.theta_m = 1}).u_dq_drop, Vec2(0, 0));
}

TEST(Cogging, HasNoMeanOverATurnAndTheRmsOfASine) {
  const auto effect = cogging(72, 0.0051, 1.2);
  constexpr int kPoints = 7200;
  double sum = 0, square_sum = 0;
  for (int i = 0; i < kPoints; ++i) {
    const double T = effect->at({.theta_m = i * kTwoPi / kPoints}).T_load;
    sum += T;
    square_sum += T * T;
  }
  EXPECT_NEAR(sum / kPoints, 0, 1e-12);
  EXPECT_NEAR(std::sqrt(square_sum / kPoints), 0.0051 / std::sqrt(2.0), 1e-9);
}

TEST(Cogging, RepeatsOrderTimesATurn) {
  const auto effect = cogging(18, 0.05, 2);
  for (double theta_m : {0.0, 0.1, 3.0})
    EXPECT_NEAR(effect->at({.theta_m = theta_m}).T_load,
                effect->at({.theta_m = theta_m + kTwoPi / 18}).T_load, 1e-13);
}

TEST(CoulombFriction, OpposesMotionInEitherDirection) {
  const auto effect = coulomb(0.25, 0.02);
  EXPECT_NEAR(effect->at({.omega_m = 5}).T_load, 0.25, 1e-12);
  EXPECT_NEAR(effect->at({.omega_m = -5}).T_load, -0.25, 1e-12);
  EXPECT_EQ(effect->at({.omega_m = 0}).T_load, 0);
}

TEST(CoulombFriction, IsWithinHalfAPercentOfTheSignAboveThreeTimesTheScale) {
  const auto effect = coulomb(1, 0.02);
  EXPECT_GT(effect->at({.omega_m = 0.06}).T_load, 0.995);
  EXPECT_LT(effect->at({.omega_m = 0.02}).T_load, 0.80);  // and softer below it
}

TEST(SumAt, AddsUpAllEffects) {
  const Effects effects{cogging(6, 0.02, 0), coulomb(0.25, 0.02)};
  const OperatingPoint point{.omega_m = 9, .theta_m = kPi / 12};
  EXPECT_NEAR(sum_at(effects, point).T_load, 0.27, 1e-12);
  EXPECT_EQ(sum_at({}, point).T_load, 0);
}

}  // namespace
}  // namespace twinrate
