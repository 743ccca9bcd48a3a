#include "controller/angle_domain.hpp"

#include <gtest/gtest.h>

#include "model/frames.hpp"
#include "tests/support/field_setter.hpp"

namespace twinrate {
namespace {

constexpr double kT_s = 1e-4;

// The Niewiara drive with its printed gains.
LoopModel loop() {
  return {.R_s = 1.05,
          .L_q = 12.7e-3,
          .K_t = 1.14,
          .J = 8.8e-3,
          .B = 0.003,
          .K_pp = 117.7,
          .K_iq = 0.08,
          .K_omega = 0.06,
          .K_p = 4.05,
          .T_d = 1.5e-4};
}

// The loop in time domain with a disturbance torque over the angle; its voltage acts T_d late.
struct Drive {
  LoopModel m = loop();
  double i_q = 0, omega_m = 0, p = 0, theta_m = 0, u_applied = 0, u_next = 0;
  template <class Torque>
  void tick(double omega_m_ref, double u_ff, const Torque& T_load) {
    p += kT_s * (omega_m - omega_m_ref);
    const double u = -m.K_iq * i_q - m.K_omega * (omega_m - omega_m_ref) - m.K_p * p + u_ff;
    constexpr int kSteps = 10;
    for (int i = 0; i < kSteps; ++i) {
      const double dt = kT_s / kSteps;
      const double di = (m.K_pp * u_applied - m.R_s * i_q) / m.L_q;
      const double domega = (m.K_t * i_q - m.B * omega_m - T_load(theta_m)) / m.J;
      i_q += dt * di;
      omega_m += dt * domega;
      theta_m += dt * omega_m;
    }
    u_applied = u_next;  // one sample of computation delay
    u_next = u;
  }
};

double cogging(double theta_m) {
  return 0.05 * std::sin(theta_m + 0.5) + 0.05 * std::sin(18 * theta_m + 2.0) +
         0.06 * std::sin(54 * theta_m + 2.6);
}

struct Ripple {
  double before = 0, after = 0;  // rms over the first and the last two of `turns` turns
};
Ripple run(AngleDomain& angle_domain, double omega_m_ref, int turns, const LoopModel& plant) {
  Drive drive;
  drive.m = plant;
  drive.omega_m = omega_m_ref;
  Ripple ripple;
  const auto ticks = static_cast<int>(turns * kTwoPi / std::abs(omega_m_ref) / kT_s);
  const int two_turns = ticks / turns * 2;
  for (int k = 0; k < ticks; ++k) {
    const double u_ff = angle_domain.step(drive.theta_m, omega_m_ref);
    drive.tick(omega_m_ref, u_ff, cogging);
    const double e = drive.omega_m - omega_m_ref;
    if (k < two_turns) ripple.before += e * e / two_turns;
    if (k >= ticks - two_turns) ripple.after += e * e / two_turns;
  }
  return {std::sqrt(ripple.before), std::sqrt(ripple.after)};
}

TEST(AngleDomain, VoltageForAConstantTorqueIsTheStaticFeedForward) {
  EXPECT_NEAR(loop().voltage_for_torque(0).real(), (1.05 / 117.7 + 0.08) / 1.14, 1e-12);
}

// H against the loop in time domain: the speed caused by a torque of one order.
TEST(AngleDomain, ModelOfTheLoopIsTheLoop) {
  for (const double omega : {20.0, 80.0, 300.0}) {
    Drive drive;
    std::complex<double> response = 0;
    double t = 0, span = 0;
    const double settled = std::ceil(1.0 * omega / kTwoPi) * kTwoPi / omega;
    const double end = settled + 10 * kTwoPi / omega;
    for (; t < end; t += kT_s) {
      drive.tick(0, 0, [&](double) { return -0.1 * std::cos(omega * t); });
      if (t < settled) continue;
      response += 2 * drive.omega_m * std::polar(1.0, -omega * (t + kT_s)) * kT_s;
      span += kT_s;
    }
    response /= span * 0.1;
    const auto H = loop().speed_for_torque(omega);
    EXPECT_LT(std::abs(response - H), 0.05 * std::abs(H)) << omega;
  }
}

TEST(AngleDomain, LearnsTheTorqueAwayAtAnySpeedAndDirection) {
  for (const double omega_m_ref : {2.0, 5.2, -5.2, 15.0}) {
    AngleDomain angle_domain({}, loop(), kT_s);
    const Ripple ripple = run(angle_domain, omega_m_ref, 20, loop());
    EXPECT_LT(ripple.after, 0.01 * ripple.before) << omega_m_ref;
    EXPECT_GT(ripple.before, 1e-3) << omega_m_ref;
  }
}

TEST(AngleDomain, LearnsWithAnInertiaThatIsWrongByAThird) {
  for (const double factor : {0.7, 1.3}) {
    LoopModel plant = loop();
    plant.J *= factor;
    AngleDomain angle_domain({}, loop(), kT_s);
    const Ripple ripple = run(angle_domain, 5.2, 30, plant);
    EXPECT_LT(ripple.after, 0.01 * ripple.before) << factor;
    // Above the loop's bandwidth the speed is 1/(J s): the identified correction is 1/factor.
    EXPECT_NEAR(std::abs(angle_domain.kappa(54 * 5.2)), 1 / factor, 0.15) << factor;
  }
}

TEST(AngleDomain, StartsFromItsOwnTable) {
  AngleDomain first({}, loop(), kT_s);
  run(first, 5.2, 20, loop());
  AngleDomainParameters table = first.learnt();
  EXPECT_NEAR(std::hypot(table.cos_Nm[17], table.sin_Nm[17]), 0.05, 0.002);
  table.learn = false;
  AngleDomain second(table, loop(), kT_s);
  const Ripple ripple = run(second, 5.2, 6, loop());
  AngleDomain none({.learn = false}, loop(), kT_s);
  EXPECT_LT(ripple.after, 0.02 * run(none, 5.2, 6, loop()).after);
  EXPECT_EQ(second.blocks(), 0);
}

TEST(AngleDomain, LeavesOrdersAboveItsHighestAlone) {
  AngleDomain angle_domain({.highest_order = 20}, loop(), kT_s);
  run(angle_domain, 5.2, 10, loop());
  const AngleDomainParameters table = angle_domain.learnt();
  EXPECT_GT(std::hypot(table.cos_Nm[17], table.sin_Nm[17]), 0.04);
  EXPECT_EQ(table.cos_Nm[53], 0);
}

TEST(AngleDomain, LearnsNothingAtStandstill) {
  AngleDomain angle_domain({}, loop(), kT_s);
  for (int k = 0; k < 10000; ++k) EXPECT_EQ(angle_domain.step(1e-7 * k, 0), 0);
  EXPECT_EQ(angle_domain.blocks(), 0);
}

// What is learnt at one speed holds at another, also in one run: the voltage of a high order leads by the delay.
TEST(AngleDomain, ATableLearntSlowlyHoldsAtThreeTimesTheSpeed) {
  AngleDomain first({}, loop(), kT_s);
  run(first, 5.2, 20, loop());
  AngleDomainParameters table = first.learnt();
  table.learn = false;
  AngleDomain second(table, loop(), kT_s), none({.learn = false}, loop(), kT_s);
  run(second, 5.2, 1, loop());
  EXPECT_LT(run(second, 15, 12, loop()).after, 0.04 * run(none, 15, 12, loop()).after);
}

}  // namespace
}  // namespace twinrate
