#include "model/effects/undo.hpp"

#include <gtest/gtest.h>

#include "model/random.hpp"
#include "tests/support/effects.hpp"

namespace twinrate::undo_test {
namespace {

constexpr double kTs = 1e-4;

struct Truth3 {
  Vec3 i_abc;
  double theta_m, omega_m;
};
Truth3 random_truth(std::uint64_t i) {
  return {inverse_clarke({3 * normal(2, 0, i), 3 * normal(2, 1, i)}), 40 * normal(2, 2, i),
          20 * normal(2, 3, i)};
}

double angle_reading(const Effects& effects, double theta_m) {
  return theta_m + sum_at(effects, {.theta_m = theta_m, .theta_e = 3 * theta_m}).theta_m;
}

// The sensor readings there, as in model and plant.
Measurement reading(const Effects& effects, const Truth3& truth, int current_sensors) {
  Measurement m;
  m.signals = kPhaseCurrents | kPosition | kSpeed;
  const double theta_e = 3 * truth.theta_m;
  m.i_abc = truth.i_abc + sum_at(effects, {.i_dq = park(clarke(truth.i_abc), theta_e),
                                           .theta_m = truth.theta_m,
                                           .theta_e = theta_e})
                              .i_abc;
  if (current_sensors == 2) m.i_abc[2] = -(m.i_abc[0] + m.i_abc[1]);
  m.theta_m = angle_reading(effects, truth.theta_m);
  m.omega_m = (m.theta_m - angle_reading(effects, truth.theta_m - kTs * truth.omega_m)) / kTs;
  return m;
}

Effects sensing_effects() {
  return {test::effect_of("current_offset",
                          {{"offset_a_A", 0.05}, {"offset_b_A", -0.02}, {"offset_c_A", 0.01}}),
          test::effect_of("current_gain", {{"gain_a", 0.015}, {"gain_b", -0.01}, {"gain_c", 0.02}}),
          test::effect_of("encoder_eccentricity", {{"amplitude_rad", 2e-3}, {"phase_rad", 0.7}}),
          test::effect_of("encoder_offset", {{"offset_rad", 0.1}})};
}

class UndoWith : public testing::TestWithParam<int> {};

TEST_P(UndoWith, BringsReadingsBackToTheTruth) {
  const Effects effects = sensing_effects();
  const SensingUndo undo(effects, 3, GetParam(), kTs);
  for (std::uint64_t i = 0; i < 200; ++i) {
    const Truth3 truth = random_truth(i);
    const Measurement m = reading(effects, truth, GetParam()), back = undo(m);
    // A gain of 2 % cubed, of up to 10 A.
    EXPECT_NEAR((back.i_abc - truth.i_abc).norm(), 0, 2e-4);
    EXPECT_GT((m.i_abc - truth.i_abc).norm(), 2e-3);
    EXPECT_NEAR(back.theta_m, truth.theta_m, 1e-9);
    EXPECT_GT(std::abs(m.theta_m - truth.theta_m), 0.09);
    EXPECT_NEAR(back.omega_m, truth.omega_m, 2e-6 + 1e-8 * std::abs(truth.omega_m));
  }
}
INSTANTIATE_TEST_SUITE_P(CurrentSensors, UndoWith, testing::Values(2, 3));

TEST(Undo, CorrectsTheSpeedOfAnEccentricDisc) {
  const Effects effects{test::effect_of("encoder_eccentricity", {{"amplitude_rad", 2e-3}})};
  const Measurement m = reading(effects, {Vec3::Zero(), 0, 10}, 3);
  EXPECT_NEAR(m.omega_m, 10 * 1.002, 1e-4);  // cos(theta_m) = 1: the reading is too fast
  EXPECT_NEAR(SensingUndo(effects, 3, 3, kTs)(m).omega_m, 10, 1e-6);
}

TEST(Undo, CarriesLateAnglesAndCurrentsForwardAtTheSpeed) {
  const Effects late{test::effect_of("signal_lag", {{"signal", 1}, {"lag_s", 1.5e-4}}),
                     test::effect_of("signal_lag", {{"signal", 2}, {"form", 1}, {"lag_s", 3e-4}})};
  const SensingUndo undo(late, 3, 3, kTs);
  EXPECT_FALSE(undo.nothing_to_do());
  Measurement m;
  m.signals = kPhaseCurrents | kPosition | kSpeed;
  m.omega_m = 20;
  m.theta_m = 1 - 20 * 3e-4;
  const Vec2 i_alphabeta(2, 1);
  m.i_abc = inverse_clarke(rotate(i_alphabeta, -3 * 20 * 1.5e-4));
  EXPECT_NEAR(undo(m).theta_m, 1, 1e-12);
  EXPECT_NEAR((clarke(undo(m).i_abc) - i_alphabeta).norm(), 0, 1e-12);
  EXPECT_NEAR(undo(m, 40).theta_m, 1 + 20 * 3e-4, 1e-12) << "the better speed";
}

TEST(Undo, ChangesOnlyMeasuredSignalsWithAnEffect) {
  const Effects effects = sensing_effects();
  const SensingUndo undo(effects, 3, 3, kTs);
  Measurement m = reading(effects, random_truth(1), 3);
  m.signals = kVoltage;
  EXPECT_EQ(undo(m).i_abc, m.i_abc);
  EXPECT_EQ(undo(m).theta_m, m.theta_m);
  EXPECT_EQ(undo(m).omega_m, m.omega_m);
  EXPECT_FALSE(undo.nothing_to_do());
  const Effects torque{test::effect_of("constant_load", {{"torque_Nm", 1}})};
  EXPECT_TRUE(SensingUndo(torque, 3, 3, kTs).nothing_to_do());
}

TEST(Undo, PredictsTheLostVoltage) {
  const Effects effects{
      test::effect_of("dead_time", {{"dead_time_s", 1e-6}}),
      test::effect_of("inverter_drop", {{"threshold_V", 0.7}, {"resistance_Ohm", 0.05}})};
  // Current along phase a only in the sense of d at theta 0: i_a = 4, i_b = i_c = -2 A.
  const OperatingPoint point{.i_dq = {4, 0}, .v_dc = 235.4};
  const Vec2 drop = predicted_drop(effects, point);
  EXPECT_NEAR(drop[0], 4.0 / 3 * (1e-6 * 1e4 * 235.4 + 0.7) + 0.05 * 4, 1e-9);
  EXPECT_NEAR(drop[1], 0, 1e-9);
}

}  // namespace
}  // namespace twinrate::undo_test
