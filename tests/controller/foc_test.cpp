#include "controller/foc.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::foc_test {
namespace {

using test::Overrides;

// One FOC and the inputs of its next tick.
struct Bench {
  explicit Bench(const Overrides& overrides = {}, const std::string& preset = "dilys2021")
      : config(test::load(preset, overrides)), controller(make_controller(config)) {
    m.v_dc = config.drive().inverter.v_dc;
  }
  void set(const Vec2& i_dq, double omega_m, double theta_e) {
    e.theta_e = theta_e;
    e.omega_m = omega_m;
    m.i_abc = inverse_clarke(inverse_park(i_dq, theta_e));
  }
  Command step() {
    ++m.k;
    return controller->step({m, e, r, nullptr});
  }
  // The voltage in the frame it will act in: 1.5 samples ahead.
  Vec2 u_dq(const Command& c) const {
    return park(c.u_alphabeta_ref, e.theta_e + 1.5 * 2e-4 * 4 * e.omega_m);
  }

  Config config;
  std::unique_ptr<Controller> controller;
  Measurement m;
  Estimate e;
  Reference r;
};

TEST(Foc, CurrentReferenceStaysWithinTheLimitForEveryDemand) {
  for (double i_d_ref : {0.0, -1.8, 2.4, -99.0}) {
    for (double omega_m_ref : {1e5, -1e5}) {
      Bench bench({"reference.slew_rad_s2=0"});
      bench.r.omega_m_ref = omega_m_ref;
      bench.r.i_d_ref = i_d_ref;
      Vec2 i_dq_ref(0, 0);
      for (int k = 0; k < 200; ++k) i_dq_ref = bench.step().i_dq_ref;
      const double i_d = std::clamp(i_d_ref, -3.0, 3.0);
      EXPECT_NEAR(i_dq_ref.norm(), 3, 1e-9);
      EXPECT_NEAR(i_dq_ref[0], i_d, 1e-12);  // the d current has precedence
      EXPECT_NEAR(i_dq_ref[1], std::copysign(std::sqrt(9 - i_d * i_d), omega_m_ref), 1e-7);
    }
  }
}

TEST(Foc, AFlyingDriveBeginsItsReferenceAtItsSpeed) {
  Bench bench({"start=flying", "reference.omega_e_rad_s=400", "reference.slew_rad_s2=100"});
  bench.r.omega_m_ref = 100;
  bench.set({0, 0}, 100, 0);
  EXPECT_DOUBLE_EQ(bench.step().omega_m_ref, 100);
  bench.r.omega_m_ref = 50;
  EXPECT_NEAR(bench.step().omega_m_ref, 100 - 100.0 / 4 * 2e-4, 1e-12);
}

TEST(Foc, VoltageStaysInTheCircleOfTheBus) {
  Bench bench({"reference.slew_rad_s2=0"});
  bench.r.omega_m_ref = 1e4;
  for (int k = 0; k < 100; ++k) {
    bench.set({0, 0}, 900, 0.1 * k);  // 25 V of EMF on a 24 V bus
    EXPECT_LE(bench.step().u_alphabeta_ref.norm(), 24 / std::sqrt(3.0) + 1e-9);
  }
  EXPECT_NEAR(bench.step().u_alphabeta_ref.norm(), 13.8564, 1e-3);
}

TEST(Foc, TheVoltageLimitFollowsTheMeasuredBus) {
  Bench bench({"reference.slew_rad_s2=0"});
  bench.r.omega_m_ref = 1e4;
  bench.m.v_dc = 12;
  for (int k = 0; k < 100; ++k) {
    bench.set({0, 0}, 900, 0);
    bench.step();
  }
  EXPECT_NEAR(bench.step().u_alphabeta_ref.norm(), 12 / std::sqrt(3.0), 1e-3);
}

TEST(Foc, FeedsTheCouplingAndTheEmfForwardWithTheirSigns) {
  for (double omega_m : {60.0, -60.0}) {
    Bench with({"machine.L_q_H=0.8e-3"}),
        without({"machine.L_q_H=0.8e-3", "controller.foc.decoupling=false"});
    for (Bench* bench : {&with, &without}) bench->set({0.4, 1.5}, omega_m, 0.7);
    const Vec2 forward = with.u_dq(with.step()) - without.u_dq(without.step());
    const double omega_e = 4 * omega_m;
    EXPECT_NEAR(forward[0], -omega_e * 0.8e-3 * 1.5, 1e-9);
    EXPECT_NEAR(forward[1], omega_e * (0.5e-3 * 0.4 + 0.007), 1e-9);
  }
}

TEST(Foc, AdvancesTheVoltageToTheAngleAtWhichItActs) {
  // Computation delay and half the hold: 1.5 samples; with no delay, half a sample.
  for (int delay : {0, 1, 2}) {
    Bench bench({fmt::format("plant.delay_samples={}", delay)});
    bench.set({0, 0}, 100, 0.5);
    bench.r.omega_m_ref = 100;
    const Vec2 u = bench.step().u_alphabeta_ref;
    // Almost all of it is EMF, on q.
    EXPECT_NEAR(std::atan2(u[1], u[0]), 0.5 + kPi / 2 + (delay + 0.5) * 2e-4 * 400, 0.02);
  }
}

TEST(Foc, PositiveSpeedErrorAsksForPositiveQCurrent) {
  Bench bench;
  bench.r.omega_m_ref = 100;
  Command c;
  for (int k = 0; k < 20; ++k) c = bench.step();
  EXPECT_GT(c.i_dq_ref[1], 0);
  EXPECT_GT(c.omega_m_ref, 0);
  EXPECT_NEAR(c.omega_m_ref, 20 * 16000.0 / 4 * 2e-4, 1e-9);  // the slew limit
}

// The integral of a constant error grows with time, however seldom the loop runs.
TEST(Foc, TheSpeedLoopIntegratesTheSameWithAnyDivider) {
  std::vector<double> grown;
  for (int divider : {1, 10}) {
    Bench bench({"reference.slew_rad_s2=0", "controller.foc.speed_bandwidth_Hz=5",
                 fmt::format("controller.foc.speed_divider={}", divider)});
    bench.r.omega_m_ref = 3;
    const double begin = bench.step().i_dq_ref[1];
    for (int k = 0; k < 1000; ++k) bench.step();
    grown.push_back(bench.step().i_dq_ref[1] - begin);
  }
  EXPECT_GT(grown[0], 0.01);
  EXPECT_NEAR(grown[1], grown[0], 0.02 * grown[0]);
}

TEST(Foc, WithTheTrueAngleHoldsTheSpeedExactlyUnderLoad) {
  for (double omega_e : {400.0, -250.0}) {
    Config config =
        test::load("dilys2021",
                   {"controller.angle_source=truth", "sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0",
                    "load.T_load_Nm=0.03", fmt::format("reference.omega_e_rad_s={}", omega_e)});
    Plant plant(config);
    const auto controller = make_controller(config);
    Command c;
    for (int k = 0; k < 15000; ++k) {
      const Measurement m = plant.sample();
      const Truth truth = plant.truth();
      c = controller->step({m, {}, config.drive().reference_at(k), &truth});
      plant.take_command(c);
      plant.advance();
    }
    EXPECT_NEAR(plant.truth().omega_m, omega_e / 4, 1e-3);
    // T_em = B omega + T_load, on q alone.
    EXPECT_NEAR(plant.truth().i_dq[1], (1e-5 * omega_e / 4 + 0.03) / 0.042, 0.01);
    EXPECT_NEAR(plant.truth().i_dq[0], 0, 0.05);
  }
}

TEST(Foc, CompensationFeedsTheEffectsTorqueForward) {
  const std::string text =
      "preset = \"dilys2021\"\n[[effect]]\nkind = \"coulomb_friction\"\nused_in = "
      "\"both\"\ntorque_Nm = 0.021\n";
  for (bool compensate : {false, true}) {
    for (double omega_m : {50.0, -50.0}) {
      Config config =
          Config::parse(text, "drive.toml",
                        {fmt::format("controller.foc.compensate_effects={}", compensate),
                         "reference.slew_rad_s2=0"});
      const auto controller = make_controller(config);
      Measurement m{.k = 0};
      m.v_dc = 24;
      Estimate e;
      e.omega_m = omega_m;
      const Reference r{.omega_m_ref = omega_m};  // no speed error
      const Command c = controller->step({m, e, r, nullptr});
      // Friction opposes: more current in the direction of motion. 0.021 Nm / 0.042 Nm/A
      EXPECT_NEAR(c.i_dq_ref[1], compensate ? std::copysign(0.5, omega_m) : 0, 1e-9);
    }
  }
}

// lead = 1/(2 pi f_c) + 1.5 T_s, by hand.
TEST(Foc, AnEstimatedLoadIsFedForwardAheadOfTheCurrentLoop) {
  Bench bench({"estimator.kind=ekf_joint", "controller.compensation=load",
               "controller.foc.current_bandwidth_Hz=200.0"});
  bench.e.T_load = 0.01;
  bench.e.dT_load_dt = 2;
  const double lead = 1 / (kTwoPi * 200) + 1.5 * 2e-4, K_t = 1.5 * 4 * 0.007;
  EXPECT_NEAR(bench.step().i_dq_ref[1], (0.01 + lead * 2) / K_t, 1e-6);
}

TEST(Foc, TheCurrentOfAStartStaysWithinTheLimit) {
  Bench bench(
      {"start=align_if", "controller.foc.i_max_A=1.0", "controller.foc.startup.i_start_A=2.0"});
  double largest = 0;
  for (int k = 0; k < 3000; ++k) largest = std::max(largest, bench.step().i_dq_ref.norm());
  EXPECT_NEAR(largest, 1, 1e-9);
}

TEST(Foc, RepeatsItsLastCommandOnInputsThatAreNotFiniteAndContinuesAfterwards) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  Bench broken, sound;
  for (Bench* bench : {&broken, &sound}) {
    bench->r.omega_m_ref = 50;
    for (int k = 0; k < 50; ++k) bench->step();
  }
  const Command last = broken.step();
  sound.step();
  for (int what = 0; what < 4; ++what) {
    const Measurement m = broken.m;
    const Estimate e = broken.e;
    if (what == 0) broken.m.i_abc[2] = kNaN;
    if (what == 1) broken.m.v_dc = kNaN;
    if (what == 2) broken.e.theta_e = kNaN;
    if (what == 3) broken.e.omega_m = std::numeric_limits<double>::infinity();
    const Command c = broken.step();
    EXPECT_EQ(c.u_alphabeta_ref, last.u_alphabeta_ref) << what;
    EXPECT_EQ(c.k, broken.m.k);
    const std::int64_t k = broken.m.k;
    broken.m = m;
    broken.m.k = k;
    broken.e = e;
  }
  // No state moved: the next command is the one of a controller that never saw them.
  EXPECT_EQ(broken.step().u_alphabeta_ref, sound.step().u_alphabeta_ref);
}

TEST(ControllerRegistry, EveryKindIsOneOfTheContractAndBuildsFromEveryPreset) {
  const std::vector<std::string> contract{"foc", "lqr"};
  ASSERT_FALSE(controller_kinds().empty());
  for (const std::string& kind : controller_kinds()) {
    EXPECT_NE(std::find(contract.begin(), contract.end(), kind), contract.end()) << kind;
    for (const std::string& preset : preset_names()) {
      // State feedback for another machine than the paper's: its own limit, and gains by bandwidth.
      test::Overrides overrides{"controller.kind=" + kind};
      if (kind == "foc") overrides.push_back("controller.foc.i_max_A=1");
      if (kind == "lqr")
        overrides.insert(overrides.end(),
                         {"controller.lqr.i_max_A=1", "controller.lqr.gains=bandwidths",
                          "controller.lqr.bandwidth_d_Hz=[900, 50]",
                          "controller.lqr.bandwidth_q_Hz=[900, 50, 20]"});
      Config config = test::load(preset, overrides);
      EXPECT_EQ(make_controller(config)->kind(), kind);
    }
  }
  EXPECT_EQ(controller_builder("dtc"), nullptr);
}

}  // namespace
}  // namespace twinrate::foc_test
