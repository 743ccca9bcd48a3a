// Kinds that the user excludes: the trace looks for none of them, names none, and lists them.
#include "trace/considered.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/bus_ripple.hpp"
#include "trace/keys.hpp"
#include "trace/measured_result.hpp"
#include "trace/split_equivalents.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

using Excluded = std::vector<std::string>;

// `missing`: share of the rows that the samples show to be missing.
TraceResult trace_without(const SyntheticDrive& drive, const Excluded& excluded,
                          double missing = 0) {
  Health health;
  const Record record = make_record(simulate_synthetic(drive), 3, health);
  health.missing_share = missing;
  TraceSettings settings;
  settings.considered = Considered(excluded);
  return trace_record(record, servo(), health, settings);
}

// Every name that the result gives a kind by, of effects, aliases and refused claims.
std::vector<std::string> names_of(const TraceResult& r) {
  std::vector<std::string> names = r.identifiable;
  for (const TracedEffect& e : r.effects) {
    names.emplace_back(e.effect->kind());
    names.insert(names.end(), e.aliases.begin(), e.aliases.end());
  }
  for (const Ambiguity& a : r.ambiguous) names.insert(names.end(), a.kinds.begin(), a.kinds.end());
  for (const Rejected& x : r.rejected) names.push_back(x.kind);
  for (const Refused& x : r.refused) names.push_back(x.kind);
  return names;
}
bool names(const TraceResult& r, std::string_view kind) {
  const std::vector<std::string> all = names_of(r);
  return std::find(all.begin(), all.end(), kind) != all.end();
}
bool has_effect(const TraceResult& r, std::string_view kind) {
  return std::any_of(r.effects.begin(), r.effects.end(),
                     [&](const TracedEffect& e) { return e.effect->kind() == kind; });
}

// Of "not_identifiable" in trace.json; empty where it does not list the kind.
std::string why_not(const TraceResult& r, const std::string& kind) {
  std::string why;
  const auto json = nlohmann::json::parse(to_json(r));
  for (const auto& row : json["not_identifiable"])
    if (row["kind"] == kind) why += row["why"].get<std::string>();
  return why;
}
constexpr const char* kWhy = "excluded by --exclude";

TEST(Considered, IsTheCatalogueLessTheExcludedKinds) {
  const Considered all, some({"torsion", "cogging", "torsion"});
  EXPECT_EQ(all.kinds(), effect_kinds());
  EXPECT_TRUE(all("torsion"));
  EXPECT_EQ(some.kinds().size(), effect_kinds().size() - 2);
  EXPECT_FALSE(some("torsion") || some("cogging"));
  EXPECT_TRUE(some("backlash"));
  EXPECT_EQ(some.of({"backlash", "torsion"}), (std::vector<std::string>{"backlash"}));
}

TEST(Excluded, ATrueKindIsNeverNamedAndItsRestIsUnexplained) {
  SyntheticDrive drive{.duration_s = 3};
  drive.extra_load = [](double, double theta, double) { return 0.06 * std::sin(17 * theta + 0.8); };
  const TraceResult r = trace_without(drive, {"cogging"});
  EXPECT_FALSE(names(r, "cogging")) << r.sentence;
  EXPECT_EQ(r.verdict, "unexplained") << r.sentence;
  ASSERT_EQ(r.unexplained.size(), 1u) << r.sentence;
  EXPECT_NEAR(r.unexplained[0].order, 17, 0.01) << r.sentence;
  EXPECT_EQ(r.sentence.find("catalogue"), std::string::npos) << r.sentence;
  EXPECT_EQ(why_not(r, "cogging"), kWhy);
  EXPECT_TRUE(r.sentence.ends_with(" Not looked for (--exclude): cogging.")) << r.sentence;
}

TEST(Excluded, OtherKindsAreTracedAsBefore) {
  SyntheticDrive drive{.duration_s = 2, .R_extra = 0.4};
  const Excluded excluded{"torsion", "inverter_drop", "dc_bus_ripple"};  // one is another name
  const TraceResult r = trace_without(drive, excluded);
  EXPECT_EQ(r.verdict, "traced") << r.sentence;
  EXPECT_TRUE(has_effect(r, "resistance"));
  for (const std::string& kind : excluded) {
    EXPECT_FALSE(names(r, kind)) << kind;
    EXPECT_EQ(why_not(r, kind), kWhy);
  }
  const TraceResult quiet = trace_without({.duration_s = 2}, {"cogging"});
  EXPECT_EQ(quiet.verdict, "nothing_missing") << quiet.sentence;
  EXPECT_NE(quiet.sentence.find("kinds of effects that were looked for and that these data"),
            std::string::npos)
      << quiet.sentence;
  EXPECT_FALSE(names(quiet, "cogging"));
}

// Friction is composed of all its sorts, and one law is tried in the place of several.
TEST(Excluded, FrictionIsComposedOfTheSortsThatAreLeft) {
  SyntheticDrive drive{.duration_s = 2};
  drive.extra_load = [](double, double, double omega) {
    return 0.15 * std::tanh(omega / 0.02) + 0.004 * omega;
  };
  const Excluded excluded{"coulomb_friction", "stribeck_friction"};
  const TraceResult r = trace_without(drive, excluded);
  for (const std::string& kind : excluded) EXPECT_FALSE(names(r, kind)) << kind << r.sentence;
  EXPECT_TRUE(has_effect(r, "viscous_friction") || r.verdict != "nothing_missing") << r.sentence;
}

// At one bus voltage a dead time has the other name of a drop, and a drop that of a dead time.
TEST(Excluded, AnOtherNameIsNoAlias) {
  const SyntheticDrive drive{.duration_s = 2, .loss_V = 2};
  const TraceResult one = trace_without(drive, {"inverter_drop"});
  EXPECT_TRUE(has_effect(one, "dead_time")) << one.sentence;
  EXPECT_FALSE(names(one, "inverter_drop")) << one.sentence;
  const TraceResult other = trace_without(drive, {"dead_time"});
  EXPECT_TRUE(has_effect(other, "inverter_drop")) << other.sentence;
  EXPECT_FALSE(names(other, "dead_time")) << other.sentence;
}

// A drop falls into a dead time and a resistance, unless one of these is excluded.
TEST(Excluded, AnEffectIsNotSplitIntoAnExcludedOne) {
  const DriveFacts facts = servo().facts();
  const auto drop = make_effect("inverter_drop");
  set_key(*drop, "threshold_V", 1);
  set_key(*drop, "resistance_Ohm", 0.4);
  const TracedEffect whole{
      .effect = drop,
      .equation = "electrical",
      .parameters = traced_parameters(*drop, {{"threshold_V", 0.01}, {"resistance_Ohm", 0.01}})};
  const auto kinds = [&](const Excluded& excluded) {
    std::vector<std::string> list;
    for (const TracedEffect& e : split_equivalents(whole, facts, Considered(excluded)))
      list.emplace_back(e.effect->kind());
    return list;
  };
  EXPECT_EQ(kinds({}), (std::vector<std::string>{"dead_time", "resistance"}));
  EXPECT_EQ(kinds({"resistance"}), std::vector<std::string>{"inverter_drop"});
  EXPECT_EQ(kinds({"dead_time"}), std::vector<std::string>{"inverter_drop"});
}

TEST(Excluded, WhatTheSamplesShowStaysALineAboutTheData) {
  const SyntheticDrive drive{.duration_s = 2};
  const TraceResult found = trace_without(drive, {}, 0.02),
                    excluded = trace_without(drive, {"missing_samples"}, 0.02);
  ASSERT_TRUE(has_effect(found, "missing_samples")) << found.sentence;
  EXPECT_FALSE(names(excluded, "missing_samples")) << excluded.sentence;
  const std::string line =
      "the samples show lost rows: share 0.02 (missing_samples, excluded by "
      "--exclude)";
  EXPECT_TRUE(std::count(excluded.health.begin(), excluded.health.end(), line));
}

TEST(Excluded, ARippleOfTheBusStaysALineAboutTheData) {
  SyntheticDrive drive{.duration_s = 2};
  RawLog raw = simulate_synthetic(drive);
  Health health;
  Record record = make_record(raw, 3, health);
  record.v_dc.clear();
  for (double t : record.t) record.v_dc.push_back(235.4 + 3 * std::sin(kTwoPi * 300 * t));
  const std::vector<char> held_out(record.size(), 0);
  const auto find = [&](const Excluded& excluded) {
    return find_bus_ripple(record, held_out, servo().facts(), {}, Considered(excluded));
  };
  ASSERT_EQ(find({}).effects.size(), 1u);
  const BusRipple ripple = find({"dc_bus_ripple"});
  EXPECT_TRUE(ripple.effects.empty());
  ASSERT_EQ(ripple.notes.size(), 1u);
  EXPECT_EQ(ripple.notes[0],
            "v_dc has a line of 3 V at 300 Hz that is not named: excluded by --exclude");
}

TEST(Excluded, AFluxMapHasNoSaturationAndNoOffset) {
  StaticSet set{.path = "made"};
  const DriveFacts facts{
      .machine =
          {.R_s = 1.0, .L_d = 0.02, .L_q = 0.1, .psi_f = 0.5, .J = 0.01, .n_p = 2, .i_rated = 15},
      .v_dc = 80,
      .f_pwm = 1e4};
  std::uint64_t k = 0;
  for (int a = -10; a <= 10; ++a)
    for (int b = -12; b <= 12; ++b, ++k) {
      set.columns["i_d"].push_back(2 * a);
      set.columns["i_q"].push_back(2 * b);
      set.columns["psi_d"].push_back(0.55 + 0.04 * a + 1e-3 * normal(6, 0, k));
      set.columns["psi_q"].push_back(0.8 * std::tanh(0.25 * b) + 1e-3 * normal(6, 1, k));
    }
  const Considered considered({"flux_linkage", "saturation", "inductance"});
  const TraceResult r =
      static_result(set, trace_flux_map(set, facts, {}, {}, considered), StaticKind::kFluxMap);
  for (const std::string& kind : considered.excluded()) {
    EXPECT_FALSE(names(r, kind)) << kind;
    EXPECT_EQ(why_not(r, kind), kWhy);
  }
  EXPECT_EQ(r.verdict, "unexplained") << r.sentence;
  EXPECT_NE(r.sentence.find("--exclude"), std::string::npos) << r.sentence;
}

// Forward and back over one turn, at rest at every row.
PositionLog holding_sweep() {
  PositionLog log{.path = "sweep"};
  const int rows = 6000;
  for (int k = 0; k < rows; ++k) {
    const double share = k / (rows - 1.0), direction = share < 0.5 ? 1 : -1;
    const double theta_m = kTwoPi * (share < 0.5 ? 2 * share : 2 - 2 * share);
    const auto n = static_cast<std::uint64_t>(k);
    log.t.push_back(1e-2 * k);
    log.theta_m.push_back(theta_m + 2e-4 * normal(1, 1, n));
    log.i_q.push_back(0.18 * std::sin(72 * theta_m + 0.7) + 0.055 * direction +
                      0.01 * normal(1, 2, n));
  }
  return log;
}

TEST(Excluded, ASweepHasNoCoggingOrNoFriction) {
  const DriveFacts facts{.machine = {.R_s = 0.53,
                                     .L_d = 2e-4,
                                     .L_q = 2e-4,
                                     .psi_f = 0.0275 / 18,
                                     .J = 5e-6,
                                     .n_p = 12,
                                     .n_slots = 18},
                         .v_dc = 24};
  const auto trace = [&](const Excluded& excluded) {
    return trace_positions(hold_out({holding_sweep()}, 0.25, facts.machine), facts,
                           {.considered = Considered(excluded)});
  };
  const TraceResult no_friction = trace({"coulomb_friction"});
  EXPECT_TRUE(has_effect(no_friction, "cogging")) << no_friction.sentence;
  EXPECT_FALSE(names(no_friction, "coulomb_friction")) << no_friction.sentence;
  const TraceResult neither = trace({"cogging", "coulomb_friction"});
  EXPECT_TRUE(neither.effects.empty()) << neither.sentence;
  EXPECT_NE(neither.verdict, "nothing_missing") << neither.sentence;
  EXPECT_EQ(why_not(neither, "cogging"), kWhy);
}

}  // namespace
}  // namespace twinrate
