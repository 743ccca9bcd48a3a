// State feedback on machines that are not the paper's: starts, rated load steps, maximum torque per
// ampere and field weakening. And the estimated load fed forward to FOC.
#include <gtest/gtest.h>

#include "controller/current_reference.hpp"
#include "controller/make_controller.hpp"
#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

TEST(StateFeedback, StartsFromUnknownAnglesByAlignmentAndRamp) {
  for (double theta_e : angles_over_a_turn(4)) {
    const Figures figures =
        run("dilys2021", {"controller.kind=lqr", "start=align_if", "run.duration_s=2.0",
                          "run.settle_s=1.6", fmt::format("plant.theta_e_start_rad={}", theta_e)});
    EXPECT_TRUE(figures.held()) << degrees(theta_e);
  }
}

// In axes that turn with the ramp, as for FOC in startup_test.cpp.
TEST(StateFeedback, TakesTheVoltageOfTheRampOver) {
  ClosedLoop loop(load("dilys2021", {"controller.kind=lqr", "start=align_if"}));
  loop.tick();
  Command before = loop.command();
  double t_s = 0, step = 0, amplitude = 0;
  while (t_s == 0 && loop.t_s() < 2) {
    loop.tick();
    const Command& now = loop.command();
    const double turned = loop.drive().T_s() * loop.drive().machine.n_p * before.omega_m_ref;
    step = (now.u_alphabeta_ref - rotate(before.u_alphabeta_ref, turned)).norm();
    amplitude = before.u_alphabeta_ref.norm();
    if (now.mode == Mode::kRun) t_s = loop.t_s();
    before = now;
  }
  ASSERT_GT(t_s, 0);
  EXPECT_GT(amplitude, 1);
  EXPECT_LT(step, 0.05 * amplitude);
}

// Rated torque at full speed; the angle must not slip and the speed come back.
TEST(StateFeedback, HoldsRatedLoadStepsOnTheMotorsOfTheOtherPapers) {
  for (const auto& [preset, T_rated] :
       {std::pair("dilys2021", 0.063), std::pair("kim-ipmsm", 2.42)}) {
    ClosedLoop loop(load(
        preset, {"controller.kind=lqr", "start=flying", "run.duration_s=1.2", "run.settle_s=0.1",
                 fmt::format("load.T_load_Nm=[[0.0, 0.0], [0.4, {}]]", T_rated)}));
    const Figures figures = run(loop);
    EXPECT_TRUE(figures.locked) << preset;
    EXPECT_LT(degrees(figures.angle_error_max), 15) << preset;
    EXPECT_NEAR(figures.speed_end / loop.reference().omega_m_ref, 1, 0.01) << preset;
  }
}

TEST(StateFeedback, WorksAtMaximumTorquePerAmpere) {
  ClosedLoop loop(load("kim-ipmsm", {"controller.kind=lqr", "start=flying", "run.duration_s=1.0",
                                     "load.T_load_Nm=[[0.0, 0.0], [0.2, 1.452]]"}));
  run(loop);
  const MachineParameters& m = loop.drive().machine;
  const Vec2 i = loop.truth().i_dq, best = mtpa(m, mtpa_for_torque(m, loop.truth().T_em));
  EXPECT_LT(best[0], -0.3);
  EXPECT_NEAR(i[0], best[0], 0.05);
  EXPECT_LT(i.norm(), 1.005 * best.norm());
}

TEST(StateFeedback, WeakensTheFieldAboveBaseSpeed) {
  const Overrides fast = {"controller.kind=lqr", "start=flying",       "reference.speed_rpm=3000",
                          "load.T_load_Nm=0.6",  "run.duration_s=1.0", "run.settle_s=0.5"};
  ClosedLoop loop(load("kim-ipmsm", fast));
  EXPECT_TRUE(run(loop).locked);
  EXPECT_LT(loop.truth().i_dq[0], -0.3);
  EXPECT_GT(loop.truth().omega_m, 0.98 * 3000 * kTwoPi / 60);
  Overrides without = fast;
  without.emplace_back("controller.lqr.field_weakening=false");
  EXPECT_LT(run("kim-ipmsm", without).speed_end, 0.95 * 3000 * kTwoPi / 60);
}

TEST(MtpaForTorque, IsTheInverseOfTheTorqueOfItsPoint) {
  const MachineParameters m = drive_of("kim-ipmsm").machine;
  for (double T : {-3.0, -0.1, 0.0, 0.02, 1.5, 4.0}) {
    const Vec2 i = mtpa(m, mtpa_for_torque(m, T));
    EXPECT_NEAR(1.5 * m.n_p * (m.psi_f + (m.L_d - m.L_q) * i[0]) * i[1], T, 1e-9) << T;
  }
}

// The dip after a load step of 3 Nm at 300 rpm.
double dip_of(const std::string& compensation) {
  ClosedLoop loop(load(
      "niewiara2020",
      {"controller.kind=foc", "controller.compensation=" + compensation, "reference.speed_rpm=300",
       "start=flying", "run.duration_s=1.0", "load.T_load_Nm=[[0.0, 0.0], [0.5, 3.0]]"}));
  double least = 1e9;
  for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
    loop.tick();
    if (loop.t_s() > 0.5) least = std::min(least, loop.truth().omega_m);
  }
  return 300 * kTwoPi / 60 - least;
}

TEST(FocCompensation, AnEstimatedLoadFedForwardMakesTheDipSmaller) {
  const double off = dip_of("off"), load = dip_of("load");
  EXPECT_LT(load, 0.5 * off);
  EXPECT_EQ(load, dip_of("paper"));
}

TEST(FocCompensation, SwitchingItDoesNotMoveTheCurrent) {
  ClosedLoop loop(
      load("niewiara2020",
           {"controller.kind=foc", "reference.speed_rpm=300", "start=flying", "load.T_load_Nm=3.0",
            "run.duration_s=1.0", "controller.compensation=[[0.0, \"off\"], [0.9, \"load\"]]"}));
  double before = 0, largest = 0, step = 0;
  for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
    loop.tick();
    const double i_q = loop.command().i_dq_ref[1];
    if (k > 8000 && k < 9000) largest = std::max(largest, std::abs(i_q - before));
    if (k == 9000) step = std::abs(i_q - before);
    before = i_q;
  }
  EXPECT_GT(largest, 0);
  EXPECT_LE(step, 2 * largest);
}

// A sensorless drive may carry a position sensor for its log; no controller looks at it.
TEST(SensorlessControl, DoesNotUseTheMeasuredAngle) {
  for (const char* kind : {"foc", "lqr"}) {
    Config config = load("dilys2021", {fmt::format("controller.kind={}", kind)});
    const auto one = make_controller(config), other = make_controller(config);
    for (std::int64_t k = 0; k < 50; ++k) {
      Measurement m{.k = k, .signals = kPhaseCurrents | kVoltage | kPosition | kSpeed, .v_dc = 24};
      Estimate e;
      e.theta_e = 0.05 * static_cast<double>(k);
      e.omega_m = 60;
      e.i_dq = {0.1, 0.4};
      const Reference r{.omega_m_ref = 100};
      const Command a = one->step({m, e, r});
      m.theta_m = 1.234;
      m.omega_m = -50;
      const Command b = other->step({m, e, r});
      EXPECT_EQ(a.u_alphabeta_ref, b.u_alphabeta_ref) << kind << k;
    }
  }
}

}  // namespace
}  // namespace twinrate::test
