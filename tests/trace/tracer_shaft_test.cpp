// A shaft or a gap between motor and load, and the inertia beside it.
#include <gtest/gtest.h>

#include "tests/trace/traced_drive.hpp"
#include "trace/keys.hpp"
#include "trace/shaft_search.hpp"

namespace twinrate {
namespace {

TEST(Tracer, FindsTheGapOfAStiffContact) {
  LooseLoad load;
  SyntheticDrive drive{.J = 8.8e-3 - load.J};
  drive.extra_load = [&](double t, double theta, double omega) { return load(t, theta, omega); };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  ASSERT_EQ(kinds(r), (Names{"backlash"})) << r.sentence;
  EXPECT_NEAR(parameter(r, "backlash", "gap").value, load.gap, 0.05 * load.gap);
  EXPECT_NEAR(parameter(r, "backlash", "J_load").value, load.J, 0.05 * load.J);
  EXPECT_NEAR(parameter(r, "backlash", "stiffness").value, load.K, 0.2 * load.K);
}

// The seam of two logs causes no ringing of the load.
TEST(Tracer, FindsAShaftInTwoLogs) {
  const auto log = [](std::uint64_t seed) {
    LooseLoad load{.J = 2.5e-3, .K = 60, .D = 0.006, .gap = 0};
    SyntheticDrive drive{.J = 8.8e-3 - load.J, .duration_s = 5, .seed = seed};
    drive.extra_load = [&](double t, double theta, double omega) { return load(t, theta, omega); };
    Health health;
    return make_record(simulate_synthetic(drive), 3, health);
  };
  Record both = log(1);
  Record second = log(2);
  for (double& theta_m : second.theta_m) theta_m += 3 * kTwoPi;
  both.append(second);
  const TraceResult r = trace_record(both, servo(), {}, {});
  ASSERT_EQ(kinds(r), (Names{"torsion"})) << r.sentence;
  // Both logs begin with a ring of the load that no row before them shows; it stands in rows that fit.
  EXPECT_NEAR(parameter(r, "torsion", "stiffness").value, 60, 5);
}

// The counts make a torque that grows with the square of the frequency. The noise model that the
// search fits holds all of the resonance, so that no candidate has a gain; in the noise of the
// sensors alone the resonance is far above it.
// The log begins in motion. The second one was a backlash: the search refined another torsion, and a
// gap was better than that.
TEST(Tracer, FindsAShaftWhoseResonanceTheNoiseModelHolds) {
  for (const auto& [damping, counts] : {std::pair{0.06, 4096}, {0.1, 8192}}) {
    LooseLoad load{.J = 5e-3, .K = 16, .D = damping, .gap = 0};
    SyntheticDrive drive{.J = 8.8e-3 - load.J, .duration_s = 8, .counts = counts};
    drive.extra_load = [&](double t, double theta, double omega) { return load(t, theta, omega); };
    RawLog raw = simulate_synthetic(drive);
    raw.drop_first(15000);
    const TraceResult r = trace_of(raw);
    ASSERT_EQ(kinds(r), (Names{"torsion"})) << r.sentence;
    EXPECT_EQ(r.verdict, "traced");
    EXPECT_NEAR(parameter(r, "torsion", "stiffness").value, 16, 0.16);
    EXPECT_NEAR(parameter(r, "torsion", "J_load").value, 5e-3, 1e-4);
    EXPECT_NEAR(parameter(r, "torsion", "damping").value, damping, 0.05 * damping);
  }
}

TEST(Tracer, CorrectsADeclaredEffectThatIsTooLarge) {
  SyntheticDrive drive;
  drive.extra_load = [](double, double, double omega) { return 0.06 * std::tanh(omega / 0.02); };
  Health health;
  const Record record = make_record(simulate_synthetic(drive), 3, health);
  DriveConfig declared = servo();
  declared.machine.B = 0.008;
  const auto friction = make_effect("coulomb_friction");
  set_key(*friction, "torque_Nm", 0.15);
  declared.effects.push_back({friction, UsedIn::kModel, 0});
  const TraceResult r = trace_record(record, declared, health, {});
  ASSERT_EQ(kinds(r), (Names{"coulomb_friction", "viscous_friction"})) << r.sentence;
  EXPECT_NEAR(parameter(r, "coulomb_friction", "torque").value, -0.09, 0.002);
  EXPECT_NEAR(parameter(r, "viscous_friction", "coefficient").value, -0.005, 1e-4);
  EXPECT_EQ(r.sentence.find("The model has too much"), 0u) << r.sentence;
  EXPECT_EQ(r.sentence.find("lacks"), std::string::npos) << r.sentence;
}

// No gap fits with the declared inertia.
TEST(Tracer, FindsAGapBesideAWrongInertia) {
  LooseLoad load;
  constexpr double kMore = 2.5e-3;  // kgm2 at the motor
  SyntheticDrive drive{.J = 8.8e-3 - load.J + kMore};
  drive.extra_load = [&](double t, double theta, double omega) { return load(t, theta, omega); };
  const TraceResult r = trace_of(simulate_synthetic(drive));
  ASSERT_EQ(kinds(r), (Names{"backlash", "inertia"})) << r.sentence;
  EXPECT_NEAR(parameter(r, "backlash", "gap").value, load.gap, 0.15 * load.gap);
  EXPECT_NEAR(parameter(r, "backlash", "J_load").value, load.J, 0.2 * load.J);
  EXPECT_NEAR(parameter(r, "inertia", "change").value, kMore, 0.12 * kMore);
}

// With the true shaft, the true inertia has the smallest residual.

TEST(ShaftSearch, FindsTheInertiaThatIsMissingBesideAShaft) {
  for (const double more : {2e-3, -2e-3}) {  // kgm2 at the motor
    LooseLoad load;
    SyntheticDrive drive{.J = 8.8e-3 - load.J + more, .duration_s = 3};
    drive.extra_load = [&](double t, double theta, double omega) { return load(t, theta, omega); };
    Health health;
    const Record record = make_record(simulate_synthetic(drive), 3, health);
    const Equations equations(record, servo().facts());
    const Sampler sampler(record, moving_rows(record), held_out_rows(record, 0.25, 3));
    const Chain chain(equations, equations, equations, sampler);
    const auto gap = make_effect("backlash");
    set_key(*gap, "J_load_kgm2", load.J);
    set_key(*gap, "gap_rad", load.gap);
    set_key(*gap, "stiffness_Nm_rad", load.K);
    set_key(*gap, "damping_Nms_rad", load.D);
    const auto found = ShaftSearch(chain, {}, ShaftSearch::Inertia::kFree).at(gap);
    const auto known = ShaftSearch(chain, {}, ShaftSearch::Inertia::kKnown).at(gap);
    EXPECT_NEAR(found.inertia, more, 0.1 * std::abs(more));
    EXPECT_EQ(known.inertia, 0);
    EXPECT_LT(found.error, 0.8 * known.error);
  }
}

}  // namespace
}  // namespace twinrate
