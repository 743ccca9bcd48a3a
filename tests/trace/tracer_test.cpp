// The tracer on an independent drive model: it finds the missing effects with their sizes, and no
// others.
#include "trace/tracer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "tests/trace/traced_drive.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

TEST(Tracer, FindsNothingWhereNothingIsMissing) {
  for (std::uint64_t seed : {1, 2}) {
    SyntheticDrive drive;
    drive.seed = seed;
    const TraceResult r = trace_of(simulate_synthetic(drive));
    EXPECT_EQ(r.verdict, "nothing_missing") << r.sentence;
    EXPECT_TRUE(r.effects.empty());
    ASSERT_TRUE(r.electrical && r.mechanical);
    // The error is noise: white after whitening, equal to the noise floor, and far below the
    // changes of the signals.
    EXPECT_GT(r.electrical->whiteness_p_value, 1e-4);
    EXPECT_GT(r.mechanical->whiteness_p_value, 1e-4);
    EXPECT_NEAR(r.electrical->after.held_out / r.electrical->noise_floor, 1, 0.15);
    EXPECT_GT(r.mechanical->no_change, 5 * r.mechanical->after.held_out);
  }
}

// The integrators of drive and equations differ by more than the sensors' noise then.
TEST(Tracer, FindsNothingWhereNothingIsMissingAndNoSensorHasNoise) {
  SyntheticDrive drive;
  drive.i_noise = 0;
  drive.lsb = 1e-9;
  drive.counts = 1 << 30;
  const TraceResult r = trace_of(simulate_synthetic(drive));
  EXPECT_EQ(r.verdict, "nothing_missing") << r.sentence;
  EXPECT_TRUE(r.effects.empty());
}

TEST(Tracer, NamesCoggingAndFrictionWithTheirSizes) {
  SyntheticDrive drive;
  drive.extra_load = [](double, double theta, double omega) {
    return 0.06 * std::sin(17 * theta + 0.8) + 0.15 * std::tanh(omega / 0.02);
  };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  EXPECT_EQ(kinds(r), (Names{"cogging", "coulomb_friction"})) << r.sentence;
  EXPECT_EQ(parameter(r, "cogging", "order").value, 17);
  EXPECT_NEAR(parameter(r, "cogging", "amplitude").value, 0.06, 0.0015);
  EXPECT_NEAR(parameter(r, "cogging", "phase").value, 0.8, 0.03);
  EXPECT_NEAR(parameter(r, "coulomb_friction", "torque").value, 0.15, 0.0015);
  ASSERT_TRUE(r.mechanical) << r.sentence;
  EXPECT_LT(r.mechanical->after.held_out, 0.5 * r.mechanical->before.held_out);
  // What is left is noise: as large as the floor, and white once it is its own autoregression.
  EXPECT_NEAR(r.mechanical->after.held_out / r.mechanical->noise_floor, 1, 0.15);
  EXPECT_GT(r.mechanical->whiteness_p_value, 1e-4);
}

// Held out: from 1 s to 1.5 s of 2 s.
bool is_held(double t) {
  return t >= 1 && t < 1.5;
}
TraceResult trace_held_out(const SyntheticDrive& drive) {
  Health health;
  const Record record = make_record(simulate_synthetic(drive), 3, health);
  std::vector<char> held;
  for (double t : record.t) held.push_back(is_held(t));
  return trace_record(record, servo(), health, {}, held);
}

// Cogging of 0.3 Nm in the rows that train and of 0.21 Nm in those held out: there the fitted
// 0.3 Nm leave 0.09 Nm, 3/7 of it, and 9/49 of its square.
TEST(TracerHoldOut, ErrorsAndGainsAreThoseOfTheHeldOutRows) {
  SyntheticDrive drive{.duration_s = 2};
  drive.extra_load = [](double t, double theta, double) {
    return (is_held(t) ? 0.21 : 0.3) * std::sin(17 * theta + 0.8);
  };
  const TraceResult r = trace_held_out(drive);
  ASSERT_EQ(kinds(r), Names{"cogging"}) << r.sentence;
  EXPECT_NEAR(parameter(r, "cogging", "amplitude").value, 0.3, 0.003);
  const auto json = nlohmann::json::parse(to_json(r));
  const auto& error = json["error"];
  EXPECT_EQ(error["equation"], "mechanical");
  EXPECT_NEAR(error["before"]["train"].get<double>(), 0.3 / std::sqrt(2), 0.03);
  EXPECT_NEAR(error["before"]["holdout"].get<double>(), 0.21 / std::sqrt(2), 0.02);
  EXPECT_NEAR(error["after"]["holdout"].get<double>() / error["before"]["holdout"].get<double>(),
              3.0 / 7, 0.04);
  EXPECT_LT(error["after"]["train"].get<double>(), 0.1 * error["before"]["train"].get<double>());
  const auto& evidence = json["effects"][0]["evidence"];
  EXPECT_NEAR(evidence["holdout_gain"].get<double>(), 1 - 9.0 / 49, 0.04);
  EXPECT_LT(evidence["delta_bic"].get<double>(), -1000);
  EXPECT_LT(evidence["f_p_value"].get<double>(), 1e-9);
}

TEST(TracerHoldOut, AnEffectThatTheHeldOutRowsDoNotHaveIsNotNamed) {
  SyntheticDrive drive{.duration_s = 2};
  drive.extra_load = [](double t, double theta, double) {
    return is_held(t) ? 0.0 : 0.06 * std::sin(17 * theta + 0.8);
  };
  const TraceResult r = trace_held_out(drive);
  for (const TracedEffect& e : r.effects) EXPECT_NE(e.effect->kind(), "cogging") << r.sentence;
}

// Structure beside an effect: what was found is named, and the verdict says that it is not all.
TEST(Tracer, AnEffectBesideStructureOutsideTheCatalogueLeavesTheTraceUnexplained) {
  SyntheticDrive drive{.duration_s = 3};
  drive.extra_load = [](double t, double theta, double) {
    return 0.08 * std::sin(2 * kPi * 13.7 * t) + 0.06 * std::sin(17 * theta + 0.8);
  };
  const auto json = nlohmann::json::parse(to_json(trace_of(simulate_synthetic(drive))));
  EXPECT_EQ(json["verdict"], "unexplained") << json["sentence"];
  ASSERT_EQ(json["effects"].size(), 1u);
  EXPECT_EQ(json["effects"][0]["kind"], "cogging");
  EXPECT_EQ(json["unexplained"]["structured"], true);
}

// Viscous and Stribeck friction together approximate the three so well that a third one adds
// little.
TEST(Tracer, SeparatesThreeKindsOfFriction) {
  SyntheticDrive drive;
  drive.extra_load = [](double, double, double omega) {
    const double sign = std::tanh(omega / 0.02);
    return (0.145 + 0.145 * std::exp(-std::pow(omega / 5.5, 2))) * sign +
           7.4e-5 * omega * std::abs(omega);
  };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  EXPECT_EQ(kinds(r), (Names{"coulomb_friction", "fan_load", "stribeck_friction"})) << r.sentence;
  EXPECT_NEAR(parameter(r, "coulomb_friction", "torque").value, 0.145, 0.003);
  EXPECT_NEAR(parameter(r, "fan_load", "coefficient").value, 7.4e-5, 2e-6);
  EXPECT_NEAR(parameter(r, "stribeck_friction", "torque").value, 0.145, 0.01);
}

// Another exponent or another smoothing is not a second sort of friction.
TEST(Tracer, TellsOneLawOfFrictionOnce) {
  SyntheticDrive drive{.duration_s = 6};
  drive.extra_load = [](double, double, double omega) {
    return 0.2 * std::exp(-std::pow(std::abs(omega) / 6, 0.7)) * std::tanh(omega / 0.02);
  };
  const TraceResult stribeck = trace_of(simulate_synthetic(drive));
  ASSERT_EQ(kinds(stribeck), Names{"stribeck_friction"}) << stribeck.sentence;
  EXPECT_NEAR(parameter(stribeck, "stribeck_friction", "torque").value, 0.2, 0.01);
  drive.extra_load = [](double, double, double omega) { return 0.15 * std::tanh(omega); };
  const TraceResult coulomb = trace_of(simulate_synthetic(drive));
  ASSERT_EQ(kinds(coulomb), Names{"coulomb_friction"}) << coulomb.sentence;
  EXPECT_NEAR(parameter(coulomb, "coulomb_friction", "torque").value, 0.15, 0.003);
}

TEST(Tracer, NamesALoadStepBesideFrictionThatIsLarger) {
  SyntheticDrive drive;
  drive.extra_load = [](double t, double theta, double omega) {
    return (t > 4.1 ? 0.25 : 0) + 0.01 * omega + 0.027 * std::sin(41 * theta + 3);
  };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  EXPECT_EQ(kinds(r), (Names{"cogging", "load_step", "viscous_friction"})) << r.sentence;
  EXPECT_NEAR(parameter(r, "load_step", "time").value, 4.1, 0.003);
  EXPECT_NEAR(parameter(r, "load_step", "torque").value, 0.25, 0.005);
}

TEST(Tracer, SeparatesAResistanceFromAnOffset) {
  SyntheticDrive warm{.duration_s = 3};
  warm.R_extra = 0.3;
  const TraceResult hot = trace_of(simulate_synthetic(warm));
  EXPECT_EQ(kinds(hot), Names{"resistance"}) << hot.sentence;
  EXPECT_NEAR(parameter(hot, "resistance", "change").value, 0.3, 0.01);
  SyntheticDrive shifted{.duration_s = 3};
  shifted.offset_a = 0.09;
  const TraceResult off = trace_of(simulate_synthetic(shifted));
  EXPECT_EQ(kinds(off), Names{"current_offset"}) << off.sentence;
  EXPECT_NEAR(parameter(off, "current_offset", "offset_a").value, 0.09, 0.002);
}

// Two effects that bias each other: the dead time depends on the true current, in the true axes.
TEST(Tracer, SeparatesADeadTimeFromTheErrorOfASensor) {
  const double seconds = 2.4 / (servo().facts().v_dc * servo().facts().f_pwm);
  const TraceResult shifted = trace_of(simulate_synthetic({.offset_a = 0.1, .loss_V = 2.4}));
  EXPECT_EQ(kinds(shifted), (Names{"current_offset", "dead_time"})) << shifted.sentence;
  EXPECT_NEAR(parameter(shifted, "dead_time", "dead_time").value, seconds, 0.02 * seconds);
  EXPECT_NEAR(parameter(shifted, "current_offset", "offset_a").value, 0.1, 0.003);
  const TraceResult turned = trace_of(simulate_synthetic({.offset_theta = 0.04, .loss_V = 2.4}));
  EXPECT_EQ(kinds(turned), (Names{"dead_time", "encoder_offset"})) << turned.sentence;
  EXPECT_NEAR(parameter(turned, "encoder_offset", "offset").value, 0.04, 0.0005);
}

// At a zero crossing of the current, such a loss turns 1 A of noise into 30 V.
TEST(Tracer, NamesFrictionBesideASteepDeadTime) {
  SyntheticDrive drive{.loss_V = 5.1, .loss_A = 0.16};
  drive.extra_load = [](double, double theta, double omega) {
    return 0.093 * std::sin(4 * theta + 0.4) * std::tanh(omega / 0.02);
  };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  ASSERT_EQ(kinds(r), (Names{"dead_time", "friction_ripple"})) << r.sentence;
  EXPECT_EQ(parameter(r, "friction_ripple", "order").value, 4);
  EXPECT_NEAR(parameter(r, "friction_ripple", "amplitude").value, 0.093, 0.002);
  const double seconds = 5.1 / (servo().facts().v_dc * servo().facts().f_pwm);
  EXPECT_NEAR(parameter(r, "dead_time", "dead_time").value, seconds, 0.02 * seconds);
}

// Without voltage inertia, flux linkage and the sensors' gains are one number, K_t/J.
TEST(Tracer, WithoutVoltageTellsOfAnInertiaThatItMayBeTheTorqueConstant) {
  RawLog raw = simulate_synthetic({.J = 1.1 * 8.8e-3, .duration_s = 3});
  raw.u_alpha.clear();
  raw.u_beta.clear();
  const TraceResult r = trace_of(raw);
  ASSERT_EQ(r.effects.size(), 1u) << r.sentence;
  EXPECT_EQ(r.verdict, "ambiguous");
  Names group = r.effects[0].aliases;
  group.emplace_back(r.effects[0].effect->kind());
  for (const char* kind : {"inertia", "flux_linkage", "current_gain"})
    EXPECT_EQ(std::count(group.begin(), group.end(), kind), 1) << kind;
}

// A voltage that acts one row late is an alias of angle and currents read one row late: one effect
// instead of two.
TEST(Tracer, NamesOneLateVoltageNotALateAngleAndLateCurrents) {
  SyntheticDrive drive{.R_extra = 0.24};
  drive.extra_load = [](double, double theta, double) { return 0.1 * std::sin(14 * theta + 0.4); };
  RawLog raw = simulate_synthetic(drive);
  for (std::vector<double>* u : {&raw.u_alpha, &raw.u_beta})
    std::rotate(u->begin(), u->begin() + 1, u->end());
  const TraceResult r = trace_of(raw);
  ASSERT_EQ(kinds(r), (Names{"cogging", "resistance", "signal_lag"})) << r.sentence;
  EXPECT_NEAR(parameter(r, "signal_lag", "lag").value, drive.T_s, 0.02 * drive.T_s);
  EXPECT_NEAR(parameter(r, "resistance", "change").value, 0.24, 0.005);
}

TEST(Tracer, ReportsADropAsAliasOfADeadTimeAtOneBusVoltage) {
  for (std::uint64_t seed : {1, 2}) {
    SyntheticDrive drive{.loss_V = 2.4};
    drive.seed = seed;
    const TraceResult r = trace_of(simulate_synthetic(drive));
    ASSERT_EQ(r.effects.size(), 1u) << r.sentence;
    Names both = r.effects[0].aliases;
    both.emplace_back(r.effects[0].effect->kind());
    std::sort(both.begin(), both.end());
    EXPECT_EQ(both, (Names{"dead_time", "inverter_drop"})) << seed << ": " << r.sentence;
    for (const std::string& name : both)
      EXPECT_EQ(std::count(r.identifiable.begin(), r.identifiable.end(), name), 0)
          << name << " may be what is there";
    for (const Rejected& x : r.rejected) EXPECT_NE(x.held_out_gain, 0) << x.kind << " not refined";
  }
}

// A device's drop has a slope besides its threshold: one effect may be both.
TEST(Tracer, ReportsADropAsAliasOfTheResistanceBesideADeadTime) {
  const TraceResult r =
      trace_of(simulate_synthetic({.duration_s = 4, .R_extra = 0.24, .loss_V = 2.4}));
  ASSERT_EQ(kinds(r), (Names{"dead_time", "resistance"})) << r.sentence;
  for (const TracedEffect& e : r.effects)
    EXPECT_EQ(e.aliases, Names{"inverter_drop"}) << e.effect->kind();
  EXPECT_EQ(r.verdict, "ambiguous");
}

// Hardly any rows tell a step near the beginning from a load that is present all the time.
TEST(Tracer, AStepNearTheBeginningMayBeAConstantLoad) {
  const auto aliases_at = [](double time_s) {
    const TraceResult r = trace_of(simulate_synthetic(
        {.extra_load = [=](double t, double, double) { return t < time_s ? 0 : 0.03; }}));
    for (const TracedEffect& e : r.effects)
      if (e.effect->kind() == "load_step") return e.aliases;
    return Names{"not found"};
  };
  const Names early = aliases_at(0.4);
  EXPECT_EQ(std::count(early.begin(), early.end(), "constant_load"), 1);
  EXPECT_EQ(aliases_at(2.5), Names{});
}

// A coarse converter repeats its values by chance.
TEST(Tracer, RepeatedCurrentsOfACoarseConverterMayBeChance) {
  const auto aliases_at = [](double lsb) {
    RawLog raw = simulate_synthetic({.duration_s = 3, .i_noise = 0.05, .lsb = lsb});
    for (std::size_t k = 50; k < raw.size(); k += 12)
      for (std::vector<double>* i : {&raw.i_a, &raw.i_b, &raw.i_c})
        if (!i->empty()) (*i)[k] = (*i)[k - 1];
    const TraceResult r = trace_of(raw);
    for (const TracedEffect& e : r.effects)
      if (e.effect->kind() == "stale_samples") return e.aliases;
    return Names{"not found"};
  };
  EXPECT_EQ(aliases_at(0.05), Names{"adc_quantisation"});
  EXPECT_EQ(aliases_at(0.01), Names{});
}

// With the coarser three, a load would be found if the threshold did not rise for fewer steps.
TEST(Tracer, FewStepsOfACoarseConverterAreNoEffect) {
  const auto expect_steps = [](std::uint64_t seed, double lsb) {
    const TraceResult r = trace_of(simulate_synthetic({.seed = seed, .slow = true, .lsb = lsb}));
    EXPECT_EQ(kinds(r), Names{"adc_quantisation"}) << seed << " " << lsb << ": " << r.sentence;
  };
  for (const std::uint64_t seed : {1, 2, 3}) expect_steps(seed, 0.2);
  for (const double lsb : {0.35, 0.4, 0.5}) expect_steps(1, lsb);
}

TEST(Tracer, FindsCoggingOfAHighOrderWithAnEncoderOffset) {
  // 1.3 rad of the period of the order: its phase in the measured angle differs from that in the
  // true angle.
  SyntheticDrive drive{.offset_theta = 0.031};
  drive.extra_load = [](double, double theta, double) { return 0.06 * std::sin(41 * theta + 0.4); };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  ASSERT_EQ(kinds(r), (Names{"cogging", "encoder_offset"})) << r.sentence;
  EXPECT_EQ(parameter(r, "cogging", "order").value, 41);
  EXPECT_NEAR(parameter(r, "cogging", "amplitude").value, 0.06, 0.001);
  EXPECT_NEAR(parameter(r, "cogging", "phase").value, 0.4, 0.02);
  EXPECT_NEAR(parameter(r, "encoder_offset", "offset").value, 0.031, 0.0003);
}

// Above the grids (60) the spectrum over a turn proposes the order.
TEST(Tracer, FindsCoggingOfAnyOrder) {
  SyntheticDrive drive;
  drive.extra_load = [](double, double theta, double) { return 0.06 * std::sin(84 * theta + 0.4); };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  ASSERT_EQ(kinds(r), Names{"cogging"}) << r.sentence;
  EXPECT_EQ(parameter(r, "cogging", "order").value, 84);
  EXPECT_NEAR(parameter(r, "cogging", "amplitude").value, 0.06, 0.001);
  EXPECT_NEAR(parameter(r, "cogging", "phase").value, 0.4, 0.02);
}

// A slow run without load with currents near zero: without the loss in the model the d residual is
// small, with the loss the noise of the currents dominates it.
TEST(Tracer, FindsADeadTimeThroughWhichTheSensorsAreLouder) {
  SyntheticDrive drive{.slow = true, .loss_V = 3.5, .loss_A = 0.07};
  drive.extra_load = [](double t, double, double) { return -external_load(t); };
  RawLog raw = simulate_synthetic(drive);
  std::fill(raw.T_load.begin(), raw.T_load.end(), 0.0);
  const TraceResult r = trace_of(raw);
  ASSERT_EQ(kinds(r), Names{"dead_time"}) << r.sentence;
  EXPECT_TRUE(r.unexplained.empty()) << r.sentence;
  const TracedParameter& zone = parameter(r, "dead_time", "linear_current");
  EXPECT_NEAR(zone.value, drive.loss_A, 0.1 * drive.loss_A);
  EXPECT_NEAR(r.electrical->after.held_out / r.electrical->noise_floor, 1, 0.15);
}

// A random load: its cause is not in the record, but the residual is not noise.
TEST(Tracer, ATorqueFarAboveTheSensorNoiseIsUnexplained) {
  SyntheticDrive drive{.duration_s = 4};
  drive.extra_load = [](double t, double, double) {
    return 0.15 * normal(5, 1, static_cast<std::uint64_t>(1000 * t));
  };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  EXPECT_EQ(kinds(r), Names{}) << r.sentence;
  EXPECT_EQ(r.verdict, "unexplained");
  EXPECT_NE(r.sentence.find("times that of white noise on the readings"), std::string::npos)
      << r.sentence;
}

TEST(Tracer, ATorquePeriodicInTimeIsOutsideTheCatalogue) {
  SyntheticDrive drive{.duration_s = 3};
  drive.extra_load = [](double t, double, double) {
    return 0.08 * std::sin(2 * 3.14159265 * 13.7 * t);
  };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  EXPECT_EQ(r.verdict, "unexplained") << r.sentence;
  EXPECT_TRUE(r.effects.empty()) << r.sentence;
  ASSERT_FALSE(r.unexplained.empty());
  EXPECT_EQ(r.unexplained[0].regressor, "t");
  EXPECT_NEAR(r.unexplained[0].frequency_Hz, 13.7, 0.02);
}

// At a twentieth of the speed what grows with its square is far below the noise.
TEST(Tracer, ASlowRunDoesNotShowWindage) {
  const TraceResult r = trace_of(simulate_synthetic({.duration_s = 2, .slow = true}));
  const auto shown = [&](const char* kind) {
    return std::count(r.identifiable.begin(), r.identifiable.end(), kind) == 1;
  };
  EXPECT_TRUE(shown("coulomb_friction"));
  EXPECT_FALSE(shown("fan_load"));
  EXPECT_EQ(std::count_if(r.not_identifiable.begin(), r.not_identifiable.end(),
                          [](const auto& blind) { return blind.first == "fan_load"; }),
            1);
}

// A shaft, a lag, what the samples show: "not found" must not read as "absent".
TEST(Tracer, EveryKindOfTheCatalogueIsToldOnce) {
  const TraceResult r = trace_of(simulate_synthetic({.duration_s = 2}));
  std::multiset<std::string> told(r.identifiable.begin(), r.identifiable.end());
  for (const auto& [kind, why] : r.not_identifiable) told.insert(kind);
  ASSERT_TRUE(r.effects.empty()) << r.sentence;
  for (const std::string& kind : effect_kinds()) EXPECT_EQ(told.count(kind), 1u) << kind;
  EXPECT_EQ(std::count(r.identifiable.begin(), r.identifiable.end(), "backlash"), 0);
}

TEST(Tracer, WithoutAVoltageTheElectricalKindsAreInNoRow) {
  RawLog raw = simulate_synthetic({.duration_s = 2});
  raw.u_alpha.clear();
  raw.u_beta.clear();
  const TraceResult r = trace_of(raw);
  const std::pair<std::string, std::string> in_no_row{"dead_time", "no row has a voltage equation"};
  EXPECT_EQ(std::count(r.not_identifiable.begin(), r.not_identifiable.end(), in_no_row), 1);
}

// What is found is off by about its sigma: of eight logs the rms of error over sigma.
TEST(Tracer, SigmasAreTheSizeOfTheErrors) {
  double square = 0;
  constexpr int kLogs = 8;
  for (std::uint64_t seed = 1; seed <= kLogs; ++seed) {
    SyntheticDrive drive{.duration_s = 2, .seed = seed, .R_extra = 0.2};
    const TraceResult r = trace_of(simulate_synthetic(drive));
    ASSERT_EQ(kinds(r), Names{"resistance"}) << r.sentence;
    const TracedParameter& change = parameter(r, "resistance", "change");
    square += std::pow((change.value - 0.2) / *change.sigma, 2) / kLogs;
  }
  EXPECT_GT(std::sqrt(square), 0.4);
  EXPECT_LT(std::sqrt(square), 1.5);
}

TEST(Tracer, AMotorAtRestCannotTell) {
  SyntheticDrive drive;
  drive.quiet = true;
  const TraceResult r = trace_of(simulate_synthetic(drive));
  EXPECT_TRUE(r.effects.empty()) << r.sentence;
  EXPECT_EQ(r.verdict, "ambiguous") << r.sentence;
  EXPECT_NE(r.sentence.find("annot tell"), std::string::npos) << r.sentence;
}

}  // namespace
}  // namespace twinrate
