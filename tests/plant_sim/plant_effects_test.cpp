// Effects in the plant: energy, measured signals, and signals that the drive does not measure.
#include <gtest/gtest.h>

#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/effects.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::plant_effects_test {
namespace {

constexpr double kTs = 2e-4;

Plant plant_with(const std::string& effects, const std::string& more = "") {
  // Locked rotor, exact sensors, commands act at once.
  return test::plant_of(
      Config::parse("preset = \"dilys2021\"\n[machine]\nJ_kgm2 = 1e4\n[sensors]\n"
                    "i_noise_rms_A = 0.0\ni_lsb_A = 0.0\n[plant]\n"
                    "delay_samples = 0\n" +
                        more + effects,
                    "drive.toml"));
}

void tick(Plant& plant, const Vec2& u) {
  plant.take_command({.k = plant.k(), .u_alphabeta_ref = u});
  ASSERT_TRUE(plant.advance());
}

TEST(PlantEffects, EnergyInIsCopperInverterStoredFrictionAndLoadWithFluxHarmonicsConservative) {
  const MachineParameters m{
      .R_s = 0.8, .L_d = 3e-3, .L_q = 7e-3, .psi_f = 0.12, .J = 2e-4, .B = 4e-4, .n_p = 3};
  const DriveFacts facts{.machine = m, .v_dc = 100, .f_pwm = 1e4};
  const Effects inverter{
      test::effect_of("dead_time", {{"dead_time_s", 2e-6}}, facts),
      test::effect_of("inverter_drop", {{"threshold_V", 0.7}, {"resistance_Ohm", 0.05}}, facts)};
  const auto flux = test::effect_of(
      "flux_harmonics", {{"order", 18}, {"amplitude_Wb", 0.01}, {"phase_rad", 0.3}}, facts);
  const DriveModel model(m, {inverter[0], inverter[1], flux}, 100);
  const auto integrator = make_integrator(Engine::kErk, model, 1);
  const auto stored = [&](const PlantState& x) {
    return 0.75 * (m.L_d * x[0] * x[0] + m.L_q * x[1] * x[1]) + 0.5 * m.J * x[2] * x[2];
  };
  PlantState x(0.5, 1, 20, 0.3);
  const double stored_before = stored(x);
  double in = 0, copper = 0, lost = 0, friction = 0, load = 0, flux_work = 0;
  constexpr double h = 2e-6;
  for (int interval = 0; interval < 50; ++interval) {
    const double phase = 0.7 * interval;
    const PlantInput input{.u_alphabeta = Vec2(20 * std::sin(phase), 20 * std::cos(1.3 * phase)),
                           .T_load = 0.2 * std::sin(0.2 * phase)};
    for (int j = 0; j < 100; ++j) {
      const PlantState middle = integrator->advance(x, input, h / 2);
      const PlantState next = integrator->advance(x, input, h);
      const auto add = [&](const PlantState& s, double weight) {
        const Vec2 i_dq = s.head<2>();
        const OperatingPoint point{
            .i_dq = i_dq, .v_dc = 100, .omega_m = s[2], .theta_m = s[3], .theta_e = 3 * s[3]};
        in += weight * 1.5 * park(input.u_alphabeta, 3 * s[3]).dot(i_dq);
        copper += weight * 1.5 * m.R_s * i_dq.squaredNorm();
        lost += weight * 1.5 * i_dq.dot(sum_at(inverter, point).u_dq_drop);
        flux_work += weight * -flux->at(point).T_load * s[2];
        friction += weight * m.B * s[2] * s[2];
        load += weight * input.T_load * s[2];
      };
      add(x, h / 6), add(middle, 4 * h / 6), add(next, h / 6);
      x = next;
    }
  }
  const double out = copper + lost + friction + load + stored(x) - stored_before;
  EXPECT_NEAR(in, out, 1e-6 * in);  // the corners of sat() reduce the order of the Simpson rule
  EXPECT_GT(lost, 0.01 * in);
  EXPECT_GT(std::abs(flux_work), 1e-3 * in) << "the flux harmonics took no part";
  EXPECT_LT(std::abs(flux_work), in);
}

TEST(PlantEffects, DeadTimeIsThereAndTheDriveDoesNotKnow) {
  Plant plant =
      plant_with("[[effect]]\nkind = \"dead_time\"\ndead_time_s = 2e-6\nlinear_current_A = 0.1\n");
  for (int k = 0; k < 60; ++k) tick(plant, {3, 0});
  // 2 us x 5 kHz x 24 V = 0.24 V a phase, 4/3 of it along phase a.
  EXPECT_NEAR(plant.truth().i_dq[0], (3 - 4.0 / 3 * 0.24) / 1.2, 1e-6);
  EXPECT_NEAR(plant.sample().u_alphabeta[0], 3, 1e-12);
  EXPECT_EQ(plant.sample().v_dc, 24);
}

TEST(PlantEffects, TheModulatorScalesByTheBusVoltageItMeasuredAndTheBusMovesOn) {
  Plant plant = plant_with(
      "[[effect]]\nkind = \"dc_bus_ripple\"\namplitude_V = 4.0\nfrequency_Hz = 700.0\n"
      "phase_rad = 0.5\n");
  const auto v_dc = [](double t) { return 24 + 4 * std::sin(kTwoPi * 700 * t + 0.5); };
  double i_a = 0, v_before = v_dc(0);
  for (int k = 0; k < 40; ++k) {
    const double t_k = k * kTs;
    EXPECT_NEAR(plant.sample().v_dc, v_dc(t_k), 1e-9);
    tick(plant, {3, 0});
    EXPECT_NEAR(plant.sample().u_alphabeta[0], 3,
                1e-9);  // duty x v_dc(t_k): as the drive computes it
    EXPECT_NEAR(clarke(plant.sample().duty_abc * v_before)[0], 3, 1e-9);
    v_before = v_dc(t_k + kTs);
    // Oracle: the RL circuit by midpoint steps.
    constexpr int kSteps = 2000;
    for (int j = 0; j < kSteps; ++j) {
      const double h = kTs / kSteps, u = 3 * v_dc(t_k + (j + 0.5) * h) / v_dc(t_k);
      const double middle = i_a + 0.5 * h * (u - 1.2 * i_a) / 5e-4;
      i_a += h * (u - 1.2 * middle) / 5e-4;
    }
    ASSERT_NEAR(plant.truth().i_dq[0], i_a, 1e-6) << k;
  }
  EXPECT_GT(std::abs(plant.truth().i_dq[0] - 2.5), 1e-4);
}

TEST(PlantEffects, SensorEffectsShowInTheMeasurementAndNotInTheTruth) {
  Plant plant = plant_with(
      "[[effect]]\nkind = \"current_offset\"\noffset_a_A = 0.05\noffset_b_A = -0.02\n"
      "[[effect]]\nkind = \"current_gain\"\ngain_a = 0.1\ngain_b = 0.0\n");
  for (int k = 0; k < 60; ++k) tick(plant, {3, 0});
  EXPECT_NEAR(plant.truth().i_dq[0], 2.5, 1e-6);
  const Vec3 i_abc = plant.sample().i_abc;
  EXPECT_NEAR(i_abc[0], 1.1 * 2.5 + 0.05, 1e-6);
  EXPECT_NEAR(i_abc[1], -1.25 - 0.02, 1e-6);
  EXPECT_NEAR(i_abc[2], -1.25, 1e-6);
}

TEST(PlantEffects, TwoCurrentSensorsMakeUpTheThirdPhase) {
  Plant two = test::plant_of(
      Config::parse("preset = \"dilys2021\"\n[sensors]\ncurrent_sensors = 2\n", "d"));
  for (int k = 0; k < 20; ++k) {
    two.take_command({.k = k, .u_alphabeta_ref = {3, 1}});
    two.advance();
    const Vec3 i_abc = two.sample().i_abc;
    EXPECT_EQ(i_abc[2], -(i_abc[0] + i_abc[1]));
  }
}

TEST(PlantEffects, AnEccentricDiscBendsAngleAndSpeedAlsoOfAnExactEncoder) {
  Plant plant = plant_with(
      "[[effect]]\nkind = \"encoder_eccentricity\"\namplitude_rad = 0.01\n"
      "[[effect]]\nkind = \"encoder_offset\"\noffset_rad = 0.2\n",
      "[load]\nT_load_Nm = 0.0\n");
  EXPECT_NEAR(plant.sample().theta_m, 0.2, 1e-12);
  Plant turning =
      test::plant_of(Config::parse("preset = \"dilys2021\"\nstart = \"flying\"\n[machine]\n"
                                   "psi_f_Wb = 1e-6\nB_Nms = 0.0\nJ_kgm2 = 1.0\n[[effect]]\n"
                                   "kind = \"encoder_eccentricity\"\namplitude_rad = 0.01\n",
                                   "d"));
  for (int k = 0; k < 300; ++k) {
    tick(turning, {0, 0});
    const double theta_m = turning.truth().theta_m;
    const Measurement m = turning.sample();
    EXPECT_NEAR(m.theta_m, theta_m + 0.01 * std::sin(theta_m), 1e-12);
    EXPECT_NEAR(m.omega_m, 100 * (1 + 0.01 * std::cos(theta_m - 0.5 * 100 * kTs)), 1e-3);
  }
}

}  // namespace
}  // namespace twinrate::plant_effects_test
