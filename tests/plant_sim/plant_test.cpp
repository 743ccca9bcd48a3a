#include "plant_sim/plant.hpp"

#include <gtest/gtest.h>

#include "tests/support/allocation_count.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::plant_test {
namespace {

using test::Overrides;

Plant ideal(Overrides overrides = {}) {
  overrides.insert(overrides.begin(), {"sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0"});
  return test::plant_of(test::load("dilys2021", overrides));
}

Command voltage(std::int64_t k, const Vec2& u) {
  return {.k = k, .u_alphabeta_ref = u};
}

void tick(Plant& plant, const Vec2& u) {
  plant.take_command(voltage(plant.k(), u));
  ASSERT_TRUE(plant.advance());
}

TEST(Plant, ALockedRotorAnswersAVoltageStepAsAnRlCircuit) {
  Plant plant = ideal({"machine.J_kgm2=1e4"});
  for (int k = 0; k < 30; ++k) tick(plant, {6, 0});
  // The command acts after the first of the thirty intervals.
  const double i_alpha = 6 / 1.2 * (1 - std::exp(-1.2 / 5e-4 * 29 * 2e-4));
  EXPECT_NEAR(clarke(plant.sample().i_abc)[0], i_alpha, 1e-6);
  EXPECT_NEAR(plant.truth().i_dq[0], i_alpha, 1e-6);
}

TEST(Plant, CoastsDownExponentiallyOnViscousFriction) {
  // A magnet of 1 uWb: no EMF, no torque.
  Plant plant = ideal({"machine.psi_f_Wb=1e-6", "machine.B_Nms=1e-4", "start=flying"});
  for (int k = 0; k < 500; ++k) tick(plant, {0, 0});
  EXPECT_NEAR(plant.truth().omega_m, 100 * std::exp(-1e-4 / 1e-5 * 0.1), 1e-4);
  // theta = omega_0 J/B (1 - exp)
  EXPECT_NEAR(plant.truth().theta_m, 100 * 0.1 * (1 - std::exp(-1.0)), 1e-5);
}

TEST(Plant, AConstantLoadSlowsItDownLinearly) {
  Plant plant = ideal({"machine.psi_f_Wb=1e-6", "machine.B_Nms=0", "start=flying",
                       "load.T_load_Nm=0.005", "load.slew_Nm_s=0"});
  for (int k = 0; k < 500; ++k) tick(plant, {0, 0});
  EXPECT_NEAR(plant.truth().omega_m, 100 - 0.005 / 1e-5 * 0.1, 1e-4);
  EXPECT_NEAR(plant.truth().T_load, 0.005, 1e-12);
}

TEST(Plant, CoulombFrictionSlowsItDownLinearly) {
  Config config = Config::parse(
      "preset = \"dilys2021\"\nstart = \"flying\"\n[machine]\npsi_f_Wb = 1e-6\nB_Nms = 0.0\n"
      "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.005\n",
      "drive.toml");
  Plant plant(config);
  for (int k = 0; k < 500; ++k) tick(plant, {0, 0});
  EXPECT_NEAR(plant.truth().omega_m, 50, 1e-4);
  EXPECT_NEAR(plant.truth().T_load, 0.005, 1e-9);
}

TEST(Plant, TheLoadComesInAtItsSlewFromZero) {
  Plant plant = ideal({"load.T_load_Nm=0.05", "load.slew_Nm_s=1"});
  EXPECT_EQ(plant.truth().T_load, 0);
  for (int k = 0; k < 100; ++k) tick(plant, {0, 0});  // 0.02 s at 1 Nm/s
  EXPECT_NEAR(plant.truth().T_load, 0.02, 1e-12);
  for (int k = 0; k < 300; ++k) tick(plant, {0, 0});
  EXPECT_NEAR(plant.truth().T_load, 0.05, 1e-12);
}

// TRUTH(k) and the speed at t_k know of a load that varies up to t_k.
TEST(Plant, TheTrueLoadIsThatOfItsOwnTick) {
  Config config = Config::parse(
      "preset = \"dilys2021\"\nstart = \"flying\"\n[machine]\npsi_f_Wb = 1e-6\nB_Nms = 0.0\n"
      "[[effect]]\nkind = \"periodic_torque\"\namplitude_Nm = 0.01\nfrequency_Hz = 40\n"
      "phase_rad = 0.3\n",
      "drive.toml");
  Plant plant(config);
  for (int k = 1; k <= 200; ++k) {
    tick(plant, {0, 0});
    const double t = 2e-4 * k;
    EXPECT_NEAR(plant.truth().T_load, 0.01 * std::sin(kTwoPi * 40 * t + 0.3), 1e-9) << k;
  }
}

TEST(Plant, AStepOfTheLoadActsFromItsTick) {
  Plant plant(ideal({"machine.psi_f_Wb=1e-6", "machine.B_Nms=0", "start=flying",
                     "load.T_load_Nm=[[0, 0], [0.01, 0.02]]", "load.slew_Nm_s=0"}));
  for (int k = 0; k < 50; ++k) tick(plant, {0, 0});
  EXPECT_NEAR(plant.truth().omega_m, 100, 1e-4);
  for (int k = 0; k < 25; ++k) tick(plant, {0, 0});
  EXPECT_NEAR(plant.truth().omega_m, 100 - 0.02 / 1e-5 * 25 * 2e-4, 1e-4);
  EXPECT_NEAR(plant.truth().T_load, 0.02, 1e-12);
}

class Delay : public testing::TestWithParam<int> {};

TEST_P(Delay, ACommandActsExactlyThatManySamplesLaterAndTheMeasurementSaysSo) {
  const int delay = GetParam();
  Plant plant = ideal({fmt::format("plant.delay_samples={}", delay), "machine.J_kgm2=1e4"});
  for (std::int64_t k = 0; k < 20; ++k) {
    // MEASUREMENT(k) carries what acted from t_{k-1} to t_k: COMMAND(k - 1 - delay).
    const Measurement m = plant.sample();
    const std::int64_t cause = k - 1 - delay;
    const double expected = cause >= 0 ? 1.0 + 0.1 * static_cast<double>(cause) : 0;
    EXPECT_EQ(m.k, k);
    EXPECT_EQ(m.t_ns, 200000 * k);
    EXPECT_NEAR(m.u_alphabeta[0], expected, 1e-12);
    EXPECT_NEAR(m.u_alphabeta[1], -expected, 1e-12);
    EXPECT_NEAR((clarke(24 * m.duty_abc) - m.u_alphabeta).norm(), 0, 1e-12);
    EXPECT_EQ(m.mode, cause >= 0 ? Mode::kIfRamp : Mode::kRun);
    EXPECT_NEAR(m.theta_forced, cause >= 0 ? 0.01 * static_cast<double>(cause) : 0, 1e-15);
    EXPECT_EQ(clarke(m.i_abc)[0] > 1e-3, cause >= 0);
    const double u = 1.0 + 0.1 * static_cast<double>(k);
    Command command = voltage(k, {u, -u});
    command.mode = Mode::kIfRamp;
    command.theta_ctrl = 0.01 * static_cast<double>(k);
    plant.take_command(command);
    ASSERT_TRUE(plant.advance());
  }
}

INSTANTIATE_TEST_SUITE_P(Samples, Delay, testing::Range(0, 5));

TEST(Plant, TheMeasurementCarriesTheLimitedVoltageNotTheOneAskedFor) {
  Plant plant = ideal();
  tick(plant, {100, 0});
  tick(plant, {0, 0});
  EXPECT_NEAR(plant.sample().u_alphabeta[0], 16, 1e-12);  // 2/3 of 24 V
}

TEST(Plant, HoldsTheLastVoltageWhereACommandIsMissingAndTripsAfterHoldTicks) {
  Plant plant = ideal({"plant.hold_ticks=5", "machine.J_kgm2=1e4"});
  tick(plant, {3, 0});
  EXPECT_TRUE(plant.advance());  // command 0 acts in interval 1
  for (int missed = 1; missed <= 5; ++missed) {
    EXPECT_FALSE(plant.advance());
    EXPECT_NEAR(plant.sample().u_alphabeta[0], 3, 1e-12);
    EXPECT_FALSE(plant.tripped());
  }
  EXPECT_FALSE(plant.advance());
  EXPECT_TRUE(plant.tripped());
  EXPECT_EQ(plant.sample().u_alphabeta, Vec2(0, 0));
  EXPECT_EQ(plant.sample().mode, Mode::kSafe);
  // The trip latches: a later command has no effect.
  for (int k = 0; k < 3; ++k) {
    plant.take_command(voltage(plant.k(), {3, 0}));
    plant.advance();
  }
  EXPECT_EQ(plant.sample().u_alphabeta, Vec2(0, 0));
}

TEST(Plant, WhereACommandIsLateTheNewestBeforeItIsUsed) {
  Plant plant = ideal({"plant.hold_ticks=5", "machine.J_kgm2=1e4"});
  tick(plant, {1, 0});
  for (std::int64_t k = 1; k < 60; ++k) {
    EXPECT_EQ(plant.advance(), k == 1) << k;  // COMMAND(0) alone was in time
    EXPECT_NEAR(plant.sample().u_alphabeta[0], k <= 2 ? 1 : 1e-2 * static_cast<double>(k - 2),
                1e-12);
    plant.take_command(voltage(k - 1, {1e-2 * static_cast<double>(k - 1), 0}));
  }
  EXPECT_FALSE(plant.tripped());
}

// It sends a command at every second tick for the tick after that of its last one.
TEST(Plant, AControllerThatFallsBehindIsOffOnceItsNewestCommandIsOlderThanHoldTicks) {
  Plant plant = ideal({"plant.hold_ticks=5", "machine.J_kgm2=1e4"});
  std::int64_t k = 0;
  for (; k < 60 && !plant.tripped(); ++k) {
    if (k % 2 == 0) plant.take_command(voltage(k / 2, {1, 0}));
    plant.advance();
  }
  // COMMAND(6) is used at tick 12, 5 ticks late. COMMAND(7) would be 6 ticks late at tick 14: none is
  // used in ticks 13 to 18.
  EXPECT_TRUE(plant.tripped());
  EXPECT_EQ(k, 19);
}

TEST(Plant, ACommandThatArrivesTwiceOrOutOfOrderActsOnceAtItsTime) {
  Plant plant = ideal({"plant.delay_samples=4"}), twin = ideal({"plant.delay_samples=4"});
  for (std::int64_t k = 0; k < 40; ++k) {
    const double u = std::sin(0.3 * static_cast<double>(k));
    plant.take_command(voltage(k, {u, 0}));
    twin.take_command(voltage(k, {u, 0}));
    if (k >= 8) twin.take_command(voltage(k - 8, {9, 9}));  // same slot, long past
    plant.advance();
    twin.advance();
    ASSERT_EQ(plant.sample().u_alphabeta, twin.sample().u_alphabeta) << k;
  }
}

TEST(Plant, ATripMeansZeroVoltageFromTheNextInterval) {
  Plant plant = ideal();
  for (int k = 0; k < 5; ++k) tick(plant, {3, 0});
  plant.emergency_stop();
  tick(plant, {3, 0});
  EXPECT_EQ(plant.sample().u_alphabeta, Vec2(0, 0));
  EXPECT_EQ(plant.sample().duty_abc, Vec3::Constant(0.5));
}

TEST(Plant, AnEncoderGivesSpeedAsTheDifferenceOfItsCounts) {
  Plant plant = ideal({"sensors.encoder_counts=1000", "start=flying", "machine.psi_f_Wb=1e-6"});
  double theta_m_before = plant.sample().theta_m;
  for (int k = 0; k < 50; ++k) {
    tick(plant, {0, 0});
    const Measurement m = plant.sample();
    EXPECT_NEAR(m.omega_m, (m.theta_m - theta_m_before) / 2e-4, 1e-9);
    EXPECT_LE(m.theta_m, plant.truth().theta_m);
    theta_m_before = m.theta_m;
  }
}

TEST(Plant, StartsWhereTheConfigSays) {
  EXPECT_NEAR(ideal({"plant.theta_e_start_rad=2"}).truth().theta_m, 0.5, 1e-15);
  EXPECT_EQ(ideal().truth().omega_m, 0);
  EXPECT_NEAR(ideal({"start=flying"}).truth().omega_m, 100, 1e-12);
}

TEST(Plant, TruthBalancesItsTorques) {
  Plant plant = ideal({"load.T_load_Nm=0.01", "load.slew_Nm_s=0", "start=flying"});
  for (int k = 0; k < 20; ++k) tick(plant, {2, 1});
  const Truth t = plant.truth();
  EXPECT_NEAR(t.T_em, 0.042 * t.i_dq[1], 1e-12);  // no saliency
  EXPECT_EQ(t.k, 20);
}

TEST(Plant, DoesNotAllocateOnItsTickPath) {
  for (const char* engine : {"rk", "erk", "cvode"}) {
    Plant plant = test::plant_of(test::load("dilys2021", {fmt::format("plant.engine={}", engine)}));
    for (int k = 0; k < 20; ++k) tick(plant, {1, 0});
    const std::int64_t before = test::allocation_count();
    for (int k = 0; k < 500; ++k) {
      plant.sample();
      plant.truth();
      plant.take_command(voltage(plant.k(), {1, 1}));
      plant.advance();
    }
    EXPECT_EQ(test::allocation_count() - before, 0) << engine;
  }
}

}  // namespace
}  // namespace twinrate::plant_test
