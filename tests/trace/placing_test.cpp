#include "trace/placing.hpp"

#include <gtest/gtest.h>

#include "tests/trace/fitted_drive.hpp"
#include "trace/acceptance.hpp"

namespace twinrate::placing_test {

std::shared_ptr<Effect> behind_a_shaft(const LooseLoad& load) {
  const auto effect = effect_with(
      load.gap > 0 ? "backlash" : "torsion",
      {{"J_load_kgm2", load.J}, {"stiffness_Nm_rad", load.K}, {"damping_Nms_rad", load.D}});
  if (load.gap > 0) set_key(*effect, "gap_rad", load.gap);
  return effect;
}

// The initial oscillation of the load has decayed.
RawLog with_load(LooseLoad load, int counts = SyntheticDrive{}.counts) {
  SyntheticDrive drive{.J = SyntheticDrive{}.J - load.J, .duration_s = 3, .counts = counts};
  drive.extra_load = [&](double t, double theta, double omega) { return load(t, theta, omega); };
  RawLog raw = simulate_synthetic(drive);
  raw.drop_first(5000);
  return raw;
}

TEST(Placing, AGapIsFoundFromTheShaftThatComesNearest) {
  const LooseLoad load;
  const FittedDrive drive(with_load(load), {behind_a_shaft(load)});
  const Fitter fitter = drive.fitter();
  const Fit nothing = fitter.start({});
  LooseLoad soft = load;
  soft.gap = 0;
  soft.K = 150;
  const auto shaft = placed(fitter, nothing, behind_a_shaft(soft));
  const std::optional<Fit> gap = search_backlash(fitter, nothing, *shaft);
  ASSERT_TRUE(gap);
  EXPECT_NEAR(get_key(*gap->members[0], "gap_rad"), load.gap, 0.03 * load.gap);
  EXPECT_NEAR(get_key(*gap->members[0], "J_load_kgm2"), load.J, 0.03 * load.J);
}

// The load bounces for long, and each count moves its impacts. No torsion comes near.
TEST(Placing, AGapIsFoundFromAnyShaftBesideCoarseCounts) {
  const LooseLoad load{.J = 3.2e-3, .K = 300, .D = 0.1, .gap = 0.02};
  const FittedDrive drive(with_load(load, 8192), {behind_a_shaft(load)});
  const Fitter fitter = drive.fitter();
  const Fit nothing = fitter.start({});
  const LooseLoad soft{.J = 5e-3, .K = 40, .D = 0.3, .gap = 0};
  const std::optional<Fit> gap = search_backlash(fitter, nothing, *behind_a_shaft(soft));
  ASSERT_TRUE(gap);
  EXPECT_NEAR(get_key(*gap->members[0], "gap_rad"), load.gap, 0.05 * load.gap);
  EXPECT_NEAR(get_key(*gap->members[0], "J_load_kgm2"), load.J, 0.05 * load.J);
}

TEST(Placing, BehindAShaftWithoutAGapTheSearchFindsNone) {
  const LooseLoad load{.J = 2e-3, .K = 60, .D = 0.02, .gap = 0};
  const auto truth = behind_a_shaft(load);
  const FittedDrive drive(with_load(load), {truth});
  const Fitter fitter = drive.fitter();
  EXPECT_FALSE(search_backlash(fitter, fitter.start({}), *truth));
}

TEST(Placing, ATorsionIsSearchedFromTheBestOfItsGrid) {
  const LooseLoad load{.J = 3.2e-3, .K = 250, .D = 0.05, .gap = 0};
  const auto truth = behind_a_shaft(load);
  const FittedDrive drive(with_load(load), {truth});
  const Fitter fitter = drive.fitter();
  const Fit nothing = fitter.start({});
  EXPECT_EQ(search_torsion(fitter, nothing, {}), nullptr);
  std::vector<Candidate> grid;
  for (double J_load : {1.3e-3, 3.5e-3})
    for (double stiffness = 14; stiffness < 600; stiffness *= 1.7)
      grid.push_back({effect_with("torsion", {{"J_load_kgm2", J_load},
                                              {"stiffness_Nm_rad", stiffness},
                                              {"damping_Nms_rad", 0.026}}),
                      {}});
  const auto found = search_torsion(fitter, nothing, grid);
  EXPECT_NEAR(get_key(*found, "J_load_kgm2"), load.J, 0.06 * load.J);
  EXPECT_NEAR(get_key(*found, "stiffness_Nm_rad"), load.K, 0.06 * load.K);
  EXPECT_NEAR(get_key(*found, "damping_Nms_rad"), load.D, 0.1 * load.D);
}

// Held out are the times at which the load is at rest behind its shaft.
TEST(Placing, AShaftIsNotRefusedWhereNothingKeptBackMovesIt) {
  const LooseLoad load{.J = 3.2e-3, .K = 250, .D = 0.08, .gap = 0};
  LooseLoad soft = load;
  soft.K = 60;
  const RawLog raw = with_load(load);
  std::vector<char> at_rest;
  for (double t : raw.t) {
    const double since = std::fmod(t, 1.7);  // external_load() jumps at 0 and 0.9
    at_rest.push_back((since > 0.65 && since < 0.88) || since > 1.5);
  }
  const FittedDrive drive(raw, {}, at_rest);  // the ringing is part of the noise
  const Fitter fitter = drive.fitter();
  const Fit nothing = fitter.start({}), shaft = fitter.start({behind_a_shaft(load)});
  EXPECT_LT(torque_energy(fitter, shaft), 0.4 * torque_energy(fitter, nothing));
  EXPECT_GT(shaft.rss_held_out, nothing.rss_held_out);
  EXPECT_TRUE(acceptable(fitter, shaft, nothing));
  EXPECT_FALSE(acceptable(fitter, fitter.start({behind_a_shaft(soft)}), nothing));
}

// The torque of the shaft follows the true angle, and so do its derivatives for the fit.
TEST(Placing, AShaftBesideAnErrorOfTheAngleArrivesInAFewSteps) {
  constexpr double kError = 0.03;  // rad, more than the twist
  const LooseLoad load{.J = 2e-3, .K = 60, .D = 0.02, .gap = 0};
  RawLog raw = with_load(load);
  for (double& theta_m : raw.theta_m) theta_m += kError * std::sin(theta_m);
  const auto eccentric =
      effect_with("encoder_eccentricity", {{"amplitude_rad", kError}, {"phase_rad", 0}});
  const FittedDrive drive(raw, {behind_a_shaft(load), eccentric});
  LooseLoad start = load;
  start.K *= 1.02;
  const Fit fit = drive.fitter().refine({behind_a_shaft(start), eccentric});
  // With derivatives at the measured angle: 60.12 Nm/rad, without improvement after twelve steps.
  EXPECT_NEAR(get_key(*fit.members[0], "stiffness_Nm_rad"), load.K, 1.5e-3 * load.K);
}

// The zones of the grid that contain all currents have equal columns up to rounding.
TEST(Placing, OfZonesThatNoCurrentLeavesTheNarrowestIsTaken) {
  const auto dead_time = effect_with("dead_time", {{"dead_time_s", 1e-6}, {"linear_current_A", 1}});
  const SyntheticDrive small_currents{
      .psi = 25, .duration_s = 2, .slow = true, .loss_V = 1, .i_noise = 1e-4, .lsb = 1e-6};
  const auto flux =
      effect_with("flux_linkage", {{"change_Wb", small_currents.psi - servo().machine.psi_f}});
  const RawLog raw = simulate_synthetic(small_currents);
  const auto largest = [](const std::vector<double>& i) {
    return std::abs(*std::max_element(
        i.begin(), i.end(), [](double a, double b) { return std::abs(a) < std::abs(b); }));
  };
  ASSERT_LT(std::max({largest(raw.i_a), largest(raw.i_b), largest(raw.i_c)}), 0.03);
  const FittedDrive drive(raw, {flux});
  const Fitter fitter = drive.fitter();
  const auto there = placed(fitter, fitter.start({flux}), dead_time);
  EXPECT_EQ(get_key(*there, "linear_current_A"), 0.03);
}

}  // namespace twinrate::placing_test
