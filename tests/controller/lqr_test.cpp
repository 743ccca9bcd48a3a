#include "controller/lqr.hpp"

#include <gtest/gtest.h>

#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::lqr_test {
namespace {

constexpr double kKpp = 117.7;

// One tick at a chosen state; K_ff and p start at zero.
struct Bench {
  explicit Bench(const test::Overrides& overrides = {}, const char* preset = "niewiara2020")
      : config(test::load(preset, overrides)), controller(make_controller(config)) {
    m.v_dc = 235.4;
  }
  Vec2 u_dq() {
    const Command c = controller->step({m, e, r, nullptr});
    ++m.k;
    m.t_ns += 100000;
    const double advance = 1.5 * config.drive().T_s() * config.drive().machine.n_p * e.omega_m;
    return park(c.u_alphabeta_ref, e.theta_e + advance);
  }
  Config config;
  std::unique_ptr<Controller> controller;
  Measurement m{.k = 0};
  Estimate e;
  Reference r;
};

TEST(Lqr, IsThePrintedLawWithDecoupling) {
  Bench bench({"controller.compensation=off"});
  bench.e.theta_e = 1.3;
  bench.e.omega_m = 10;
  bench.e.i_dq = {0.4, 1.5};
  bench.r.omega_m_ref = 10;  // p_omega stays 0; p_id = T_s i_d
  const Vec2 u = bench.u_dq();
  const double L = 12.7e-3, psi_f = 0.253333333333, omega_e = 30;
  EXPECT_NEAR(u[0], kKpp * (-0.22 * 0.4 - 8.14 * 1e-4 * 0.4) - omega_e * L * 1.5, 1e-6);
  EXPECT_NEAR(u[1], kKpp * (-0.08 * 1.5 - 0.06 * 10) + omega_e * (L * 0.4 + psi_f), 1e-6);
}

TEST(Lqr, AnEstimatedLoadAsksForMoreVoltageWhereCompensationIsOn) {
  for (const bool on : {false, true}) {
    Bench bench({fmt::format("controller.compensation={}", on ? "paper" : "off")});
    bench.e.T_load = 2;
    EXPECT_NEAR(bench.u_dq()[1], on ? kKpp * 0.078 * 2 : 0, 0.01) << on;
  }
}

// Voltage over the speed of a salient machine at i_d_ref; the designs are i_max/8 apart.
double gain_of_the_speed(double i_d_ref) {
  double u[2];
  for (int i = 0; i < 2; ++i) {
    Bench bench(
        {"controller.kind=lqr", "controller.lqr.gains=bandwidths", "controller.compensation=off",
         "controller.lqr.current_angle=reference", "controller.lqr.i_max_A=8"},
        "kim-ipmsm");
    bench.r.i_d_ref = i_d_ref;
    bench.e.i_dq = {i_d_ref, 0};
    for (int k = 0; k < 3; ++k) bench.u_dq();
    bench.e.omega_m = 0.1 * i;
    u[i] = bench.u_dq()[1];
  }
  return (u[0] - u[1]) / 0.1;
}

TEST(Lqr, BetweenTwoDesignsTheGainIsLinearInTheReferenceOfId) {
  const double at_3 = gain_of_the_speed(-3), at_4 = gain_of_the_speed(-4);
  ASSERT_GT(std::abs(at_3 - at_4), 1e-3 * std::abs(at_3));
  EXPECT_NEAR(gain_of_the_speed(-3.25), 0.75 * at_3 + 0.25 * at_4, 0.02 * std::abs(at_3 - at_4));
}

TEST(Lqr, SwitchingTheCompensationDoesNotMoveTheVoltage) {
  Bench bench({"controller.compensation=[[0.0, \"off\"], [0.0005, \"paper\"], [0.001, \"off\"]]"});
  bench.e.T_load = 2;
  bench.e.i_dq = {0, 2 / 1.14};
  const double u_before = bench.u_dq()[1];
  for (int k = 1; k < 15; ++k) EXPECT_NEAR(bench.u_dq()[1], u_before, 1e-9) << k;
  int switched = 0;
  Bench again({"controller.compensation=[[0.0, \"off\"], [0.0005, \"paper\"]]"});
  for (int k = 0; k < 15; ++k) {
    again.u_dq();
    if (again.controller->take_event().reason == Reason::kModeChange) ++switched;
  }
  EXPECT_EQ(switched, 1);
}

// R_s i + j omega_e L i + j omega_e psi_f; within a tick's share of the integrals.
TEST(Lqr, AFlyingStartBeginsWithTheVoltageThatHoldsTheCurrents) {
  Bench bench({"controller.compensation=off", "start=flying", "reference.speed_rpm=300"});
  bench.e.theta_e = 1.3;
  bench.e.omega_m = 31.4;
  bench.e.i_dq = {0.4, 1.5};
  bench.r.omega_m_ref = 31.4;
  const Vec2 u = bench.u_dq();
  const double L = 12.7e-3, psi_f = 0.253333333333, omega_e = 3 * 31.4;
  EXPECT_NEAR(u[0], 1.05 * 0.4 - omega_e * L * 1.5, 0.05);
  EXPECT_NEAR(u[1], 1.05 * 1.5 + omega_e * (L * 0.4 + psi_f), 0.05);
}

// MPAC: the voltage that brings i_q to the limit, including the pending voltage.
TEST(Lqr, LandsTheCurrentOnItsLimit) {
  Bench bench({"controller.compensation=off", "plant.delay_samples=0", "controller.lqr.i_max_A=3"});
  bench.e.i_dq = {0, 2.5};
  bench.r.omega_m_ref = 1e5;  // far beyond the limits
  double u_q = 0;
  for (int k = 0; k < 40; ++k) u_q = bench.u_dq()[1];
  EXPECT_NEAR(2.5 + 1e-4 / 12.7e-3 * (u_q - 1.05 * 2.5), 3.0, 1e-6);
  bench.r.omega_m_ref = -1e5;
  bench.e.i_dq = {0, -2.5};
  for (int k = 0; k < 400; ++k) u_q = bench.u_dq()[1];
  EXPECT_NEAR(-2.5 + 1e-4 / 12.7e-3 * (u_q + 1.05 * 2.5), -3.0, 1e-6);
}

// As after an I/f ramp: a small i_q is not forced to zero within one tick.
TEST(Lqr, LeavesSomeTorqueCurrentWhereTheRampTakesAll) {
  const auto u_q = [](const char* i_max) {
    Bench bench({"controller.compensation=off", "plant.delay_samples=0",
                 std::string("controller.lqr.i_max_A=") + i_max});
    bench.e.i_dq = {3, -0.05};
    return bench.u_dq()[1];
  };
  EXPECT_NEAR(u_q("3"), u_q("100"), 1e-9);
}

// Two voltages are on their way: the older acts first. A step of each is i + T_s/L (u - R i).
TEST(Lqr, LandsTheCurrentOnItsLimitThroughTheVoltagesInTheirOrder) {
  Bench bench({"controller.compensation=off", "plant.delay_samples=2", "controller.lqr.i_max_A=3"});
  bench.r.omega_m_ref = 1e5;  // wants far too much
  const auto step = [](double i, double u) { return i + 1e-4 / 12.7e-3 * (u - 1.05 * i); };
  std::array<double, 2> on_the_way{};  // the older first
  int landed = 0;
  for (int k = 0; k < 60; ++k) {
    const double i_q = k % 3 == 0 ? 2.9 : k % 3 == 1 ? 2.2 : 2.6;
    bench.e.i_dq = {0, i_q};
    const Command c = bench.controller->step({bench.m, bench.e, bench.r, nullptr});
    ++bench.m.k;
    const double u_q = c.u_alphabeta_ref[1];  // at rest, at the angle 0
    const double then = step(step(step(i_q, on_the_way[0]), on_the_way[1]), u_q);
    on_the_way = {on_the_way[1], u_q};
    if (k < 10 || std::abs(u_q) > 117) continue;  // limited by the modulator
    EXPECT_NEAR(then, 3, 1e-6) << k;
    ++landed;
  }
  EXPECT_GT(landed, 10);
}

TEST(Lqr, StaysInsideTheLinearRangeOfTheModulator) {
  Bench bench({"controller.compensation=off", "controller.lqr.i_max_A=1000"});
  bench.r.omega_m_ref = 1e5;
  for (int k = 0; k < 200; ++k) {
    const Vec2 u = bench.u_dq();
    EXPECT_LE(u.cwiseAbs().maxCoeff(), kKpp * (1 + 1e-12));
    EXPECT_LE(u.norm(), 235.4 / std::sqrt(3) * (1 + 1e-12));
  }
}

// With all of u_d taken (1 of 2/sqrt 3) the circle leaves sqrt(4/3 - 1) of the half bus for u_q.
TEST(Lqr, UsesTheWholeVoltageCircle) {
  Bench bench({"controller.compensation=off", "controller.lqr.i_max_A=1000"});
  bench.e.i_dq = {-50, 0};
  bench.r.omega_m_ref = 1e5;
  Vec2 u;
  for (int k = 0; k < 200; ++k) u = bench.u_dq();
  EXPECT_NEAR(u[0], kKpp, 1e-9);
  EXPECT_NEAR(u[1], kKpp * std::sqrt(1.0 / 3), 1e-6);
}

// A second at the limit leaves nothing behind: the integral is where the limit is.
TEST(Lqr, DoesNotWindUpAtTheVoltageLimit) {
  Bench bench({"controller.compensation=off", "controller.lqr.i_max_A=1000"});
  bench.r.omega_m_ref = 100;
  for (int k = 0; k < 10000; ++k) bench.u_dq();
  EXPECT_NEAR(bench.u_dq()[1], kKpp, 1e-6);
  bench.r.omega_m_ref = -100;
  int ticks = 0;
  while (bench.u_dq()[1] > 0 && ticks < 20000) ++ticks;
  EXPECT_LT(ticks, 2000);
}

TEST(Lqr, RepeatsItsLastCommandOnInputsThatAreNotFinite) {
  Bench bench;
  bench.e.i_dq = {0, 1};
  const Command before = bench.controller->step({bench.m, bench.e, bench.r, nullptr});
  bench.e.i_dq[1] = std::numeric_limits<double>::quiet_NaN();
  ++bench.m.k;
  const Command after = bench.controller->step({bench.m, bench.e, bench.r, nullptr});
  EXPECT_EQ(after.k, before.k + 1);
  EXPECT_EQ(after.u_alphabeta_ref, before.u_alphabeta_ref);
}

TEST(Lqr, AlignsBeforeItRuns) {
  Bench bench({"start=align_if", "controller.lqr.startup.i_start_A=5"});
  const Command c = bench.controller->step({bench.m, bench.e, bench.r, nullptr});
  EXPECT_EQ(c.mode, Mode::kAlign);
  EXPECT_NEAR((c.u_alphabeta_ref - Vec2(0, 1.05 * 5)).norm(), 0, 1e-12);  // at 90 deg
}

// A step of i_d_ref moves u_d by (K_id + R_s/K_pp) K_pp, and the integral follows by itself.
TEST(Lqr, FeedsAReferenceOfTheDCurrentForward) {
  Bench bench({"controller.compensation=off"});
  bench.r.i_d_ref = -2;
  EXPECT_NEAR(bench.u_dq()[0], -2 * (kKpp * 0.22 + 1.05) - kKpp * 8.14 * 1e-4 * 2, 1e-9);
}

}  // namespace
}  // namespace twinrate::lqr_test
