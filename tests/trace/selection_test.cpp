// One round of the forward selection with given candidates.
#include "trace/selection.hpp"

#include <gtest/gtest.h>

#include "tests/trace/fitted_drive.hpp"
#include "trace/acceptance.hpp"

namespace twinrate::selection_test {

// An offset acts on the voltage like a threshold. With it, only the slope of the drop remains; an
// overcompensated dead time makes the threshold negative.
TEST(Selection, ADropThatFallsBelowZeroBesideTheNewCandidateIsAResistance) {
  constexpr double kChange = 0.3, kOffset = 0.1;  // ohm, A
  const auto offset = effect_with("current_offset", {{"offset_a_A", kOffset}}),
             resistance = effect_with("resistance", {{"change_Ohm", kChange}}),
             drop =
                 effect_with("inverter_drop", {{"threshold_V", 0.01}, {"resistance_Ohm", kChange}});
  const FittedDrive drive(simulate_synthetic({.duration_s = 2,
                                              .R_extra = kChange,
                                              .offset_a = kOffset,
                                              .loss_V = -0.003,
                                              .loss_A = 0.01}),
                          {resistance, offset});
  const Fitter fitter = drive.fitter();
  EXPECT_GT(get_key(*fitter.refine({drop}).members[0], "threshold_V"), 0.01);
  std::vector<Sampled> columns = drive.chain().columns(*offset);
  for (Sampled& x : columns) x = drive.chain().regressor(x);
  RoundState state;
  const Fit fit = select_one(fitter, {{offset, columns}}, {drop}, {}, state);
  ASSERT_EQ(kinds_of(fit.members), (std::vector<std::string>{"current_offset", "resistance"}));
  EXPECT_NEAR(get_key(*fit.members[0], "change_Ohm"), kChange, 0.02 * kChange);
  EXPECT_NEAR(get_key(*fit.members[1], "offset_a_A"), kOffset, 0.01 * kOffset);
}

// The slope of a drop absorbs the effect of an inductance; with the inductance it becomes negative,
// and the drop is a dead time.
TEST(Selection, ADropWhoseSlopeFallsBelowZeroBesideTheNewCandidateIsADeadTime) {
  constexpr double kChange = 0.18 * 12.7e-3;   // H
  constexpr double kLoss = 3.8, kZone = 0.18;  // V, A
  const auto inductance =
                 effect_with("inductance", {{"change_d_H", kChange}, {"change_q_H", kChange}}),
             drop = effect_with(
                 "inverter_drop",
                 {{"threshold_V", kLoss}, {"resistance_Ohm", 0.05}, {"linear_current_A", kZone}});
  const FittedDrive drive(simulate_synthetic({.L = 12.7e-3 + kChange,
                                              .duration_s = 2,
                                              .R_extra = -0.005,
                                              .loss_V = kLoss,
                                              .loss_A = kZone}),
                          {inductance, drop});
  const Fitter fitter = drive.fitter();
  std::vector<Sampled> columns = drive.chain().columns(*inductance);
  for (Sampled& x : columns) x = drive.chain().regressor(x);
  RoundState state;
  const Fit fit = select_one(fitter, {{inductance, columns}}, {drop}, {}, state);
  ASSERT_EQ(kinds_of(fit.members), (std::vector<std::string>{"dead_time", "inductance"}));
}

// The candidates are clamped; a clamped drop has its own shape.
TEST(Selection, ADropWithASmoothCornerGetsItsShape) {
  const auto shape_found = [](bool smooth) {
    constexpr double kLoss = 3.8, kZone = 0.3;  // V, A
    const auto drop =
        effect_with("dead_time", {{"dead_time_s", 1e-6}, {"linear_current_A", kZone}});
    const FittedDrive drive(
        simulate_synthetic(
            {.duration_s = 2, .loss_V = kLoss, .loss_A = kZone, .smooth_loss = smooth}),
        {drop});
    const Fitter fitter = drive.fitter();
    std::vector<Sampled> columns = drive.chain().columns(*drop);
    for (Sampled& x : columns) x = drive.chain().regressor(x);
    RoundState state;
    const Fit fit = select_one(fitter, {{drop, columns}}, {}, {}, state);
    EXPECT_EQ(fit.members.size(), 1u);
    const Effect& found = *fit.members.at(0);
    EXPECT_NEAR(get_key(found, "linear_current_A"), kZone, 0.02 * kZone);
    return get_key(found, "shape");
  };
  EXPECT_EQ(shape_found(true), 1) << "tanh";
  EXPECT_EQ(shape_found(false), 0);
}

// A winding warms up: its resistance fits the late rows, and the first ones refuse it.
TEST(Selection, ARefusedCandidateOfALargeGainIsHandedOn) {
  const auto refused_of = [](double warm) {
    const RawLog raw = simulate_synthetic({.duration_s = 2, .R_warm = warm, .warm_s = 2});
    std::vector<char> held_out(raw.size(), 0);
    std::fill_n(held_out.begin(), raw.size() / 6, 1);
    const auto resistance = effect_with("resistance", {{"change_Ohm", 0.3 * warm}});
    const FittedDrive drive(raw, {resistance}, held_out);
    std::vector<Sampled> columns = drive.chain().columns(*resistance);
    for (Sampled& x : columns) x = drive.chain().regressor(x);
    RoundState state;
    const Fit fit = select_one(drive.fitter(), {{resistance, columns}}, {}, {}, state);
    EXPECT_FALSE(state.added) << warm;
    std::vector<std::string> kinds;
    for (const Fit& refused : state.refused) kinds.emplace_back(refused.members.back()->kind());
    return kinds;
  };
  EXPECT_EQ(refused_of(1), (std::vector<std::string>{"resistance"}));
  EXPECT_TRUE(refused_of(0.02).empty());
}

// Each of four reasons for a gap, alone, and just short of it.
TEST(Selection, AGapTakesThePlaceOfAShaftForEachOfFourReasons) {
  constexpr double kMargin = 10, kGain = 1000;
  const LeftByShaft shaft{.energy = 1, .pieces = 1, .held_out = 1};
  const auto gap = [&](LeftByShaft left, double more) {
    return is_gap(left, shaft, kGain, more, kMargin);
  };
  EXPECT_FALSE(gap({1.1, 1, 1.1}, 0)) << "none";
  EXPECT_TRUE(gap({0.99, 1, 1.1}, 101)) << "a tenth of the gain besides";
  EXPECT_FALSE(gap({0.99, 1, 1.1}, 99));
  EXPECT_FALSE(gap({1.01, 1, 1.1}, 101)) << "the plain error rises";
  EXPECT_TRUE(gap({0.74, 1, 1.1}, 0)) << "the plain error";
  EXPECT_FALSE(gap({0.76, 1, 1.1}, 0));
  EXPECT_TRUE(gap({1.1, 0.84, 0.99}, 0)) << "the error by pieces";
  EXPECT_FALSE(gap({1.1, 0.86, 0.99}, 0));
  EXPECT_FALSE(gap({1.1, 0.84, 1.01}, 0)) << "the held-out error rises";
  EXPECT_TRUE(gap({1.1, 1, 0.79}, 1001)) << "twice the gain";
  EXPECT_FALSE(gap({1.1, 1, 0.81}, 1001)) << "little less of the held-out error";
  EXPECT_FALSE(gap({1.1, 1, 0.79}, 999));
}

// Only the simpler of the two may be worse, by no more than a few hundred.
TEST(Selection, ADeadTimeMayFallALittleShortOfADropWithASlope) {
  const auto dead_time = effect_with("dead_time", {{"dead_time_s", 1e-6}}),
             drop = effect_with("inverter_drop", {{"threshold_V", 1}, {"resistance_Ohm", 0.1}}),
             resistance = effect_with("resistance", {{"change_Ohm", 0.1}});
  EXPECT_DOUBLE_EQ(credit(*dead_time, *drop, 2000), 20);
  EXPECT_DOUBLE_EQ(credit(*dead_time, *drop, 1e6), 500);
  EXPECT_EQ(credit(*drop, *dead_time, 1e6), 0);
  EXPECT_EQ(credit(*dead_time, *resistance, 1e6), 0);
}

// If no current leaves the zones of a grid, its places have equal columns, and rounding decides
// which one is better.
TEST(Selection, OfTwoPlacesThatExplainTheSameTheFirstIsTaken) {
  constexpr double kRounding = 1e-12;
  const auto cogging = [](double order) {
    return effect_with("cogging", {{"order", order}, {"amplitude_Nm", 0.1}});
  };
  const FittedDrive drive(
      simulate_synthetic(
          {.duration_s = 2,
           .extra_load = [](double, double theta, double) { return 0.1 * std::sin(17 * theta); }}),
      {cogging(17)});
  const Fitter fitter = drive.fitter();
  const Fit fit = fitter.start({});
  std::vector<Sampled> same = drive.chain().columns(*cogging(17));
  for (Sampled& x : same) x = drive.chain().regressor(x);
  std::vector<Sampled> better = same;
  for (Sampled& x : better) add(x, fit.y, kRounding);
  // The second one has another order as its name; the columns are compared.
  for (bool first_is_better : {false, true}) {
    const std::vector<Score> scores = ranked(fitter,
                                             {{cogging(17), first_is_better ? better : same},
                                              {cogging(18), first_is_better ? same : better}},
                                             fit);
    const auto found = std::find_if(scores.begin(), scores.end(),
                                    [](const Score& s) { return s.effect->kind() == "cogging"; });
    ASSERT_NE(found, scores.end());
    EXPECT_GT(found->gain, 100);
    EXPECT_EQ(get_key(*found->effect, "order"), 17);
  }
}

// A step that was placed before the friction is 0.1 s off; a second step beside it is the same one.
TEST(Selection, AStepBesideAStepMovesTheFirstOne) {
  const double kTorque = 0.3, kTime = 1.2;  // Nm, s
  const auto step_at = [kTorque](double time_s) {
    return effect_with("load_step", {{"torque_Nm", kTorque}, {"time_s", time_s}});
  };
  const FittedDrive drive(
      simulate_synthetic(
          {.duration_s = 2,
           .extra_load = [=](double t, double, double) { return t >= kTime ? kTorque : 0.0; }}),
      {step_at(kTime)});
  const auto candidate = step_at(kTime + 0.16);
  std::vector<Sampled> columns = drive.chain().columns(*candidate);
  for (Sampled& x : columns) x = drive.chain().regressor(x);
  RoundState state;
  const Fit fit =
      select_one(drive.fitter(), {{candidate, columns}}, {step_at(kTime - 0.1)}, {}, state);
  ASSERT_EQ(kinds_of(fit.members), (std::vector<std::string>{"load_step"}));
  EXPECT_NEAR(get_key(*fit.members[0], "time_s"), kTime, 1e-3);
  EXPECT_NEAR(get_key(*fit.members[0], "torque_Nm"), kTorque, 0.01 * kTorque);
}

// A step that was placed before the inertia is in a held-out stretch (1.33 to 1.50 s); there the
// inertia alone raises the error.
TEST(Selection, AStepIsMovedBeforeTheNewCandidateIsRejected) {
  const double kTorque = 0.75, kTime = 1.467, kChange = 0.13 * SyntheticDrive{}.J;  // Nm, s, kgm2
  const auto inertia = effect_with("inertia", {{"change_kgm2", kChange}});
  const auto step_at = [kTorque](double time_s) {
    return effect_with("load_step", {{"torque_Nm", kTorque}, {"time_s", time_s}});
  };
  const FittedDrive drive(
      simulate_synthetic(
          {.J = SyntheticDrive{}.J + kChange,
           .duration_s = 4,
           .extra_load = [=](double t, double, double) { return t >= kTime ? kTorque : 0.0; }}),
      {inertia, step_at(kTime)});
  const Fitter fitter = drive.fitter();
  std::vector<Sampled> columns = drive.chain().columns(*inertia);
  for (Sampled& x : columns) x = drive.chain().regressor(x);
  const Fit wrong = fitter.refine({step_at(kTime - 0.1)});
  EXPECT_GT(fitter.refine(with(wrong.members, inertia)).rss_held_out, wrong.rss_held_out);
  RoundState state;
  const Fit fit = select_one(fitter, {{inertia, columns}}, {step_at(kTime - 0.1)}, {}, state);
  ASSERT_EQ(kinds_of(fit.members), (std::vector<std::string>{"inertia", "load_step"}));
  EXPECT_NEAR(get_key(*fit.members[0], "time_s"), kTime, 1e-3);
  EXPECT_NEAR(get_key(*fit.members[1], "change_kgm2"), kChange, 0.01 * kChange);
}

// Training rows have one direction, held-out rows the other: there load and friction cancel, and
// each of them alone, which absorbs both, is wrong.
TEST(Selection, TwoCandidatesRejectedAloneAreAcceptedTogether) {
  constexpr double kLoad = 0.1, kFriction = 0.003;  // Nm, Nms/rad
  const SyntheticDrive drive_of{.B = SyntheticDrive{}.B + kFriction,
                                .duration_s = 4,
                                .extra_load = [](double, double, double) { return kLoad; }};
  const auto load = effect_with("constant_load", {{"torque_Nm", kLoad}});
  const auto friction = effect_with("viscous_friction", {{"coefficient_Nms", kFriction}});
  const RawLog raw = simulate_synthetic(drive_of);
  std::vector<char> backwards;
  for (double t : raw.t) backwards.push_back(wanted_speed(t) < 0);
  const FittedDrive drive(raw, {load, friction}, backwards);
  Fitter fitter = drive.fitter();
  const double declared = fitter.start({}).rss_held_out;
  std::vector<Candidate> candidates;
  for (const auto& effect : {load, friction}) {
    EXPECT_GT(fitter.refine({effect}).rss_held_out, declared) << effect->kind();
    candidates.push_back({effect, drive.chain().columns(*effect)});
    for (Sampled& x : candidates.back().columns) x = drive.chain().regressor(x);
  }
  RoundState state;
  const Fit fit = select_one(fitter, candidates, {}, {}, state);
  ASSERT_EQ(kinds_of(fit.members), (std::vector<std::string>{"constant_load", "viscous_friction"}));
  for (const auto& member : fit.members)
    EXPECT_NEAR(member->kind() == "constant_load" ? get_key(*member, "torque_Nm") / kLoad
                                                  : get_key(*member, "coefficient_Nms") / kFriction,
                1, 0.05);
  // A margin that they do not clearly exceed: neither is accepted.
  fitter.set_margin(1e4);
  EXPECT_TRUE(select_one(fitter, candidates, {}, {}, state).members.empty());
}

// With the slope of a drop at small currents, the sensor noise dominates the residual. If its size
// was estimated from a residual that contained the drop, the correction is too large.
TEST(Selection, AnEffectFarAboveTheNoiseIsAcceptedDespiteAnOverestimatedNoise) {
  constexpr double kLoss = 20, kZone = 1;  // V, A
  const auto drop =
      effect_with("inverter_drop",
                  {{"threshold_V", kLoss}, {"resistance_Ohm", 0.001}, {"linear_current_A", kZone}});
  FittedDrive drive(
      simulate_synthetic({.duration_s = 2, .slow = true, .loss_V = kLoss, .loss_A = kZone}),
      {drop});
  const Fit as_it_is = drive.fitter().start({drop});
  const double rows = static_cast<double>(drive.fitter().training().count(as_it_is.y));
  EXPECT_TRUE(as_it_is.valid);
  EXPECT_NEAR(as_it_is.rss, rows, 0.3 * rows);
  drive.scale_noise(2);
  const Fit fit = drive.fitter().start({drop});
  EXPECT_TRUE(fit.valid);
  EXPECT_GT(fit.rss, 0.2 * rows);
  EXPECT_LT(fit.rss, rows);
  EXPECT_GT(drive.fitter().start({}).rss, 100 * fit.rss);
}

}  // namespace twinrate::selection_test
