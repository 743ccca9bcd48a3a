// The traits of every effect of the registry: each is stated, and is true of the effect's own
// equations as far as these show it.
#include <cstring>
#include <set>

#include "model/effects/catalogue.hpp"
#include "model/effects/memory.hpp"
#include "model/effects/portrait.hpp"
#include "model/random.hpp"
#include "tests/support/effects.hpp"

namespace twinrate::traits_test {
namespace {

using Period = Traits::Period;
using Repeats = Traits::Repeats;
using Place = Traits::Place;
using View = Traits::View;

std::shared_ptr<Effect> plausible(const std::string& kind,
                                  std::map<std::string, double> values = {}) {
  const auto effect = make_effect(kind);
  test::PlausibleValues set;
  effect->fields(set);
  test::FieldSetter given(std::move(values));
  effect->fields(given);
  EXPECT_EQ(effect->prepare(test::drive_facts()), "");
  return effect;
}

OperatingPoint point_at(std::uint64_t index) {
  OperatingPoint point{.t = 1 + uniform(2, 0, index),
                       .i_dq = Vec2(normal(2, 1, index), normal(2, 2, index)),
                       .u_dq = Vec2(20 * normal(2, 3, index), 20 * normal(2, 4, index)),
                       .v_dc = 235.4,
                       .omega_m = 3 + normal(2, 5, index),
                       .theta_m = normal(2, 6, index)};
  point.theta_e = 3 * point.theta_m;
  return point;
}

bool has_key(const std::string& kind, const std::string& key) {
  test::FieldSetter look;
  make_effect(kind)->fields(look);
  return look.keys().contains(key);
}

double value_of(Effect& effect, const char* key) {
  test::FieldSetter look;
  effect.fields(look);
  return look.seen_values().at(key);
}

double apart(const Effect& effect, const OperatingPoint& a, const OperatingPoint& b) {
  return (test::flat(effect.at(a)) - test::flat(effect.at(b))).norm();
}

class EveryKind : public testing::TestWithParam<std::string> {
 protected:
  const Traits traits_ = make_effect(GetParam())->tracing().traits();
  bool knows(const char* kind) const { return make_effect(kind) != nullptr; }
};

TEST_P(EveryKind, StatesEveryTrait) {
  EXPECT_NE(traits_.equation, Traits::Equation::kUnstated) << "equation";
  EXPECT_NE(traits_.family.name, Traits::Family::kUnstated) << "family";
  EXPECT_GE(traits_.family.rank, 0) << "rank in the family";
  EXPECT_NE(traits_.period.in, Period::kUnstated) << "period";
  EXPECT_NE(traits_.repeats.how, Repeats::kUnstated) << "repeats";
  EXPECT_NE(traits_.place, Place::kUnstated) << "place";
  EXPECT_NE(traits_.noise, Traits::Noise::kUnstated) << "noise";
  EXPECT_NE(traits_.on_command, Traits::Answer::kUnstated) << "on_command";
  EXPECT_NE(traits_.loss, Traits::Loss::kUnstated) << "loss";
  EXPECT_NE(traits_.view, View::kUnstated) << "view";
  EXPECT_NE(traits_.told_by, Traits::Run::kUnstated) << "told_by";
  EXPECT_TRUE(traits_.relatives.is_stated()) << "relatives";
  EXPECT_TRUE(traits_.readings.is_stated()) << "readings";
  EXPECT_TRUE(traits_.bounds.is_stated()) << "bounds";
  EXPECT_TRUE(traits_.faults.is_stated()) << "faults";
}

TEST_P(EveryKind, HasAPortrait) {
  const Portrait& portrait = make_effect(GetParam())->portrait();
  for (const char* text :
       {portrait.parameters, portrait.equation, portrait.shows, portrait.taken_for})
    EXPECT_TRUE(text && *text);
  EXPECT_NE(portrait.signal, Portrait::kNoSignal);
  EXPECT_NE(portrait.over, Portrait::kNoAxis);
  EXPECT_LT(portrait.from_s, portrait.to_s);
}

TEST_P(EveryKind, ExplainsAnEquationThatItActsOn) {
  const int acts = make_effect(GetParam())->acts_on();
  const Traits::Equation expected = acts == kOnTorque ? Traits::Equation::kMechanical
                                    : acts & (kOnVoltage | kOnFlux | kOnBus)
                                        ? Traits::Equation::kElectrical
                                        : Traits::Equation::kSensing;
  EXPECT_EQ(traits_.equation, expected);
}

// A sine of the angle or of time: the same a period later, the opposite half a period later.
void expect_period(const Effect& effect, double angle, double time) {
  for (std::uint64_t i = 0; i < 20; ++i) {
    const OperatingPoint here = point_at(i);
    OperatingPoint later = here, half = here;
    later.theta_m += angle, later.t += time;
    half.theta_m += angle / 2, half.t += time / 2;
    const auto x = test::flat(effect.at(here));
    EXPECT_LT(apart(effect, here, later), 1e-9 * (1 + x.norm()));
    EXPECT_LT((x + test::flat(effect.at(half))).norm(), 1e-9 * (1 + x.norm()));
  }
}

TEST_P(EveryKind, HasThePeriodThatItStates) {
  const Period period = traits_.period;
  EXPECT_EQ(period.of_angle(), period.order > 0 || *period.order_key);
  EXPECT_EQ(period.in == Period::kTime || period.in == Period::kAngleOrTime,
            *period.frequency_key != 0);
  if (*period.order_key) {
    EXPECT_TRUE(has_key(GetParam(), period.order_key));
  }
  if (*period.frequency_key) {
    EXPECT_TRUE(has_key(GetParam(), period.frequency_key));
  }
  std::map<std::string, double> still;  // the other period switched off
  if (period.in == Period::kAngleOrTime) still[period.frequency_key] = 0;
  if (period.of_angle()) {
    const auto effect = plausible(GetParam(), still);
    const double order = *period.order_key ? value_of(*effect, period.order_key) : period.order;
    expect_period(*effect, kTwoPi / order, 0);
  }
  if (*period.frequency_key) {
    still.clear();
    if (*period.order_key) still[period.order_key] = 0;
    const auto effect = plausible(GetParam(), still);
    expect_period(*effect, 0, 1 / value_of(*effect, period.frequency_key));
  }
}

// What turns with the phases follows theta_e.
TEST_P(EveryKind, DoesNotDependOnTheMechanicalAngleUnlessItHasAnOrder) {
  if (traits_.period.of_angle()) return;
  const auto effect = plausible(GetParam());
  for (std::uint64_t i = 0; i < 20; ++i) {
    OperatingPoint turned = point_at(i);
    turned.theta_m += 0.37;
    EXPECT_EQ(apart(*effect, point_at(i), turned), 0);
  }
}

TEST_P(EveryKind, RepeatsByAKeyOfItsOwn) {
  const bool by_key = traits_.repeats.how == Repeats::kByKey;
  EXPECT_EQ(by_key, *traits_.repeats.key != 0);
  if (by_key) {
    EXPECT_TRUE(has_key(GetParam(), traits_.repeats.key));
  }
  EXPECT_GE(traits_.repeats.distance, 0);
  EXPECT_TRUE(by_key || traits_.repeats.distance == 0);
}

TEST_P(EveryKind, IsPlacedAsItsTracedKeysAsk) {
  const auto effect = plausible(GetParam());
  const std::vector<TracedKey> keys = make_effect(GetParam())->tracing().traced_keys();
  bool grid = false, no_grid = false;
  for (const TracedKey& key : keys)
    if (!key.linear || effect->tracing().regressor_count() == 0)
      (key.grid.empty() ? no_grid : grid) = true;
  ShaftFacts shaft;
  SamplingFacts sampling;
  const bool is_shaft = effect->describe_shaft(shaft);
  switch (traits_.place) {
    case Place::kLinear:
      EXPECT_TRUE(!keys.empty() && !grid && !no_grid);
      break;
    case Place::kGrid:
      EXPECT_TRUE(grid && !no_grid);
      break;
    case Place::kZone:
      EXPECT_TRUE(grid && has_key(GetParam(), "linear_current_A"));
      break;
    case Place::kMoment:
      EXPECT_TRUE(no_grid && traits_.repeats.distance > 0);
      break;
    case Place::kBusLine:
      EXPECT_EQ(effect->acts_on(), kOnBus);
      break;
    case Place::kLine:
      EXPECT_TRUE(keys.empty() && traits_.period.of_angle() && *traits_.period.frequency_key);
      break;
    case Place::kSamples:
      EXPECT_TRUE(keys.empty() && effect->describe_sampling(sampling));
      break;
    default:
      EXPECT_TRUE(is_shaft);
  }
  EXPECT_EQ(is_shaft, traits_.place == Place::kShaft || traits_.place == Place::kGap);
  EXPECT_EQ(shaft.gap > 0, traits_.place == Place::kGap);
  EXPECT_EQ(!traits_.faults.empty(), traits_.place == Place::kSamples);
}

TEST_P(EveryKind, IsOnTheCommandIfItsVoltageFollowsTheCommand) {
  const auto effect = plausible(GetParam());
  std::vector<OperatingPoint> record, louder;
  for (std::uint64_t i = 0; i < 20; ++i) {
    record.push_back(point_at(i));
    louder.push_back(point_at(i));
    louder.back().u_dq *= 2;
  }
  std::vector<Contribution> sums(record.size()), of_louder(record.size());
  contributions(*effect, record, 1e-4, sums);
  contributions(*effect, louder, 1e-4, of_louder);
  bool follows = false;
  for (std::size_t k = 0; k < sums.size(); ++k)
    follows = follows || test::flat(sums[k]) != test::flat(of_louder[k]);
  EXPECT_EQ(follows, traits_.on_command == Traits::Answer::kYes);
}

TEST_P(EveryKind, TakesPowerIfItIsALoss) {
  if (traits_.loss == Traits::Loss::kNo) return;
  const auto effect = plausible(GetParam());
  double all = 0;
  for (std::uint64_t i = 0; i < 50; ++i) {
    const OperatingPoint point = point_at(i);
    const Contribution c = effect->at(point);
    const double power = c.T_load * point.omega_m + 1.5 * c.u_dq_drop.dot(point.i_dq);
    EXPECT_GE(power, 0);
    all += power;
  }
  EXPECT_GT(all, 0);
}

TEST_P(EveryKind, IsDrawnInItsOwnEquation) {
  if (traits_.view >= View::kTorqueOverPeriod) {
    EXPECT_EQ(traits_.equation, Traits::Equation::kMechanical);
  } else if (traits_.view > View::kShare) {
    EXPECT_EQ(traits_.equation, Traits::Equation::kElectrical);
  }
  if (traits_.view == View::kTorqueOverPeriod || traits_.view == View::kTorqueOverPeriodByMotion) {
    EXPECT_TRUE(traits_.period.of_angle());
  }
}

TEST_P(EveryKind, HasRelativesThatSayTheSame) {
  for (const Traits::Relative& relative : traits_.relatives) {
    ASSERT_TRUE(knows(relative.kind)) << relative.kind;
    const Traits other = make_effect(relative.kind)->tracing().traits();
    bool same = false;
    for (const Traits::Relative& back : other.relatives)
      same = same || (back.kind == GetParam() && back.run == relative.run);
    EXPECT_TRUE(same) << relative.kind << " does not name " << GetParam() << " with that run";
  }
}

TEST_P(EveryKind, ReadsAsAnotherKindByKeysOfBoth) {
  for (const Traits::Reading& reading : traits_.readings) {
    ASSERT_TRUE(knows(reading.kind)) << reading.kind;
    EXPECT_TRUE(reading.keys.is_stated());
    for (const Traits::KeyPair& pair : reading.keys) {
      EXPECT_TRUE(has_key(GetParam(), pair.from)) << pair.from;
      EXPECT_TRUE(has_key(reading.kind, pair.to)) << pair.to;
    }
  }
}

TEST_P(EveryKind, BoundsKeysOfItsOwnByPositiveValues) {
  for (const Traits::Bound& bound : traits_.bounds) {
    EXPECT_TRUE(has_key(GetParam(), bound.key)) << bound.key;
    EXPECT_GT(bound.most, 0);
  }
}

TEST_P(EveryKind, TakesTheSizeOfAFaultInAKeyOfItsOwn) {
  for (const Traits::FromFault& fault : traits_.faults) {
    EXPECT_TRUE(has_key(GetParam(), fault.size_key)) << fault.size_key;
    if (*fault.choice_key) {
      EXPECT_TRUE(has_key(GetParam(), fault.choice_key)) << fault.choice_key;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Registry, EveryKind, testing::ValuesIn(effect_kinds()),
                         [](const auto& i) { return i.param; });

TEST(Catalogue, RanksTheMembersOfAFamilyWithoutGapsOrTies) {
  std::map<Traits::Family, std::set<int>> ranks;
  std::map<Traits::Family, int> count;
  for (const std::string& kind : effect_kinds()) {
    const Traits::InFamily family = make_effect(kind)->tracing().traits().family;
    ranks[family.name].insert(family.rank);
    ++count[family.name];
  }
  for (const auto& [family, of_family] : ranks) {
    EXPECT_EQ(static_cast<int>(of_family.size()), count[family]) << static_cast<int>(family);
    EXPECT_EQ(*of_family.rbegin(), count[family] - 1) << static_cast<int>(family);
  }
}

TEST(Catalogue, HoldsTheKindsThatTheTracerMakesItself) {
  for (const Place place : {Place::kLine, Place::kGap, Place::kBusLine, Place::kMoment})
    EXPECT_EQ(make_placed(place)->tracing().traits().place, place);
  using Family = Traits::Family;
  EXPECT_EQ(make_of(Family::kInertia)->kind(), "inertia");
  EXPECT_EQ(make_of(Family::kLag)->kind(), "signal_lag");
  EXPECT_EQ(make_of(Family::kResistance)->kind(), "resistance");
  EXPECT_EQ(kinds_of(Family::kFriction),
            (std::vector<std::string>{"viscous_friction", "coulomb_friction", "stribeck_friction",
                                      "fan_load"}));
}

// A reading of signal_lag: its traits are those of the signal that is late.
TEST(SignalLag, IsOfTheEquationOfItsSignal) {
  const auto of = [](int signal) {
    return test::effect_of("signal_lag", {{"signal", signal}, {"lag_s", 1e-4}})->tracing().traits();
  };
  EXPECT_EQ(of(SamplingFacts::kVoltage).equation, Traits::Equation::kElectrical);
  EXPECT_EQ(of(SamplingFacts::kVoltage).on_command, Traits::Answer::kYes);
  for (int signal : {SamplingFacts::kCurrent, SamplingFacts::kAngle, SamplingFacts::kSpeed}) {
    EXPECT_EQ(of(signal).equation, Traits::Equation::kSensing) << signal;
    EXPECT_EQ(of(signal).on_command, Traits::Answer::kNo) << signal;
  }
  EXPECT_EQ(of(SamplingFacts::kAngle).noise, Traits::Noise::kSome);
  EXPECT_EQ(of(SamplingFacts::kCurrent).noise, Traits::Noise::kMimics);
}

// From kinds and keys as a drive file has them, to the names of the same thing.
TEST(Readings, OfAnInverterDropAreADeadTimeAndAResistance) {
  const auto drop = make_effect("inverter_drop");
  const Traits::Reading* threshold = reading_of(*drop, Traits::Reading::kItsThreshold);
  const Traits::Reading* slope = reading_of(*drop, Traits::Reading::kItsSlope);
  ASSERT_TRUE(threshold && slope);
  EXPECT_STREQ(threshold->kind, "dead_time");
  EXPECT_STREQ(slope->kind, "resistance");
  EXPECT_EQ(kinds_read(*make_effect("inertia"), Traits::Reading::kWithoutVoltage),
            (std::vector<std::string>{"flux_linkage", "current_gain"}));
  EXPECT_EQ(reading_of(*drop, Traits::Reading::kWithoutGap), nullptr);
}

}  // namespace
}  // namespace twinrate::traits_test
