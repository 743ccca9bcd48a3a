// docs/ipmsm-drive.md: preset kim-ipmsm in closed loop, against the figures of an independent
// implementation. The whole table, 24 angles a row: bench/ipmsm_table.
#include <gtest/gtest.h>

#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

// The preset's events end a run in safe mode; tests of filter errors switch them off.
const Overrides kFlying{"start=flying", "estimator.prediction=euler", "run.duration_s=0.95",
                        "controller.foc.synchronism.watch=false"};
const Overrides kHeavy{"machine.J_kgm2=1e-3", "controller.foc.speed_bandwidth_Hz=15"};
const Overrides kTruth{"controller.angle_source=truth"};

Overrides join(Overrides left, const Overrides& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

struct AtLoad {
  double angle_deg = 0, largest_deg = 0, speed_error_rpm = 0;
};

// Means over the last 0.15 s, under 0.6 of rated torque; the largest error from the load step on.
AtLoad at_load(const Overrides& overrides) {
  ClosedLoop loop(load("kim-ipmsm", overrides));
  AtLoad figures;
  int count = 0;
  for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
    loop.tick();
    const double error = degrees(loop.angle_error());
    if (loop.t_s() > 0.6) figures.largest_deg = std::max(figures.largest_deg, std::abs(error));
    if (loop.t_s() < 0.8) continue;
    ++count;
    figures.angle_deg += error;
    figures.speed_error_rpm += (loop.estimate().omega_m - loop.truth().omega_m) * 30 / kPi;
  }
  figures.angle_deg /= count;
  figures.speed_error_rpm /= count;
  return figures;
}

TEST(IpmsmTable, ExtendedEmfIsHalfAPeriodOfRotationAheadWithEulerAndExactWithRk4) {
  const AtLoad euler = at_load(join(kFlying, {"estimator.kind=eemf"}));
  EXPECT_NEAR(euler.angle_deg, 1.2, 0.3);
  EXPECT_NEAR(euler.largest_deg, 1.8, 0.4);
  EXPECT_NEAR(euler.speed_error_rpm, 0, 1);
  const AtLoad rk4 = at_load(join(kFlying, {"estimator.kind=eemf", "estimator.prediction=rk4"}));
  EXPECT_NEAR(rk4.angle_deg, 0, 0.1);
}

TEST(IpmsmTable, TheRotorModelHasNoErrorAndLessThanADegreeInTheLoadTransient) {
  const AtLoad figures = at_load(join(kFlying, {"estimator.prediction=rk4"}));
  EXPECT_NEAR(figures.angle_deg, 0, 0.1);
  EXPECT_LT(figures.largest_deg, 1);
  EXPECT_GT(figures.largest_deg, 0.05);  // there is noise
  EXPECT_NEAR(figures.speed_error_rpm, 0, 1);
}

TEST(IpmsmTable, ActiveFluxIsWithinTwoDegrees) {
  const AtLoad figures = at_load(join(join(kFlying, kHeavy), {"estimator.kind=active_flux"}));
  EXPECT_NEAR(figures.angle_deg, 1.35, 0.4);
  EXPECT_LT(figures.largest_deg, 3.5);
}

TEST(IpmsmTable, ThePrintedFilterIsThirtyDegreesOffOnASalientRotorAndRightOnItsOwnMachine) {
  const Overrides printed = join(kFlying, {"estimator.kind=backemf_printed"});
  const AtLoad riding = at_load(join(printed, kTruth));
  EXPECT_NEAR(riding.angle_deg, 34, 0.2 * 34);
  EXPECT_NEAR(riding.speed_error_rpm, 87, 0.2 * 87);
  const AtLoad closed = at_load(join(printed, kHeavy));
  EXPECT_NEAR(closed.angle_deg, 34, 0.2 * 34);
  EXPECT_NEAR(closed.speed_error_rpm, 87, 0.2 * 87);
  const AtLoad own = at_load(join(join(printed, kHeavy), {"plant.saliency=fixed_axes"}));
  EXPECT_LT(std::abs(own.angle_deg), 1.5);
}

AtLoad with_background_twenty_times_slower(const char* kind, const char* policy) {
  return at_load(join(kFlying, {"estimator.prediction=rk4", fmt::format("estimator.kind={}", kind),
                                fmt::format("gain.policy={}", policy), "rates.n=20"}));
}

TEST(GainPolicies, TheRotorModelsGainDoesNotGrowOldAndTheExtendedEmfsMustTurn) {
  for (const char* policy : {"paper", "rotor_frame"})
    EXPECT_LT(with_background_twenty_times_slower("dq_ekf", policy).largest_deg, 1) << policy;
  for (const char* policy : {"rotor_frame", "scheduled"})
    EXPECT_LT(with_background_twenty_times_slower("eemf", policy).largest_deg, 1.5) << policy;
  EXPECT_GT(with_background_twenty_times_slower("eemf", "paper").largest_deg, 90);
}

// Its gain is constant in stator axes: every policy equals a gain every tick.
TEST(GainPolicies, ThePrintedFiltersGainStandsStillOnTheStator) {
  for (const char* policy : {"paper", "rotate", "rotor_frame", "scheduled"}) {
    const AtLoad figures = at_load(
        join(join(kFlying, kTruth), {"estimator.prediction=rk4", "estimator.kind=backemf_printed",
                                     "rates.n=20", fmt::format("gain.policy={}", policy)}));
    EXPECT_NEAR(figures.angle_deg, 34.2, 0.3) << policy;
  }
}

TEST(GainPolicies, WithAGainEveryTickTheTurnedOneIsTheOrdinaryFilterBitForBit) {
  for (const char* kind : {"backemf_printed", "active_flux", "eemf", "dq_ekf"})
    for (const char* policy : {"rotate", "rotor_frame", "extrapolate"}) {
      const Overrides base = join(kFlying, {fmt::format("estimator.kind={}", kind), "rates.n=1"});
      ClosedLoop ordinary(load("kim-ipmsm", base));
      ClosedLoop loop(load("kim-ipmsm", join(base, {fmt::format("gain.policy={}", policy)})));
      for (int k = 0; k < 1000; ++k) {
        ordinary.tick();
        loop.tick();
        ASSERT_EQ(ordinary.estimate().x_hat, loop.estimate().x_hat) << kind << policy << k;
      }
    }
}

// Locked rotor, a voltage of 20 V rotating at 100 Hz.
double standstill_angle_error_deg(double theta_e) {
  Config config = load("kim-ipmsm", {"machine.J_kgm2=1000", "run.duration_s=0.3",
                                     fmt::format("plant.theta_e_start_rad={}", theta_e)});
  const auto filter = make_filter(config);
  Plant plant(config);
  FastLoop fast(filter, config.drive().gain.policy, 1);
  BackgroundLoop background(filter, config.drive().gain.policy, 1);
  Estimate e;
  for (int k = 0; k < 3000; ++k) {
    e = fast.tick(plant.sample());
    fast.take_gain(background.step(e));
    plant.take_command({.k = k, .u_alphabeta_ref = rotate(Vec2(20, 0), kTwoPi * 100 * k * 1e-4)});
    plant.advance();
  }
  return degrees(wrap_pi(e.theta_e - theta_e));
}

TEST(Standstill, TheSaliencyShowsTheAngleUpToHalfATurnAndNeverWhichEndIsNorth) {
  int reversed = 0;
  for (double theta_e : angles_over_a_turn(8)) {
    const double error = std::abs(standstill_angle_error_deg(theta_e));
    EXPECT_LT(std::min(error, 180 - error), 1) << degrees(theta_e);
    reversed += error > 90;
  }
  EXPECT_EQ(reversed, 4);
}

bool reaches_2000_rpm(const Overrides& overrides) {
  const Figures figures = run("kim-ipmsm", overrides);
  return figures.held() && std::abs(figures.speed_mean - 209.44) < 2;
}

TEST(DirectStart, TheRotorModelComesToSpeedFromEveryAngleWithAndWithoutLoad) {
  for (double T_load : {0.0, 1.452}) {
    int locked = 0;
    for (double theta_e : angles_over_a_turn(8))
      locked += reaches_2000_rpm({"run.duration_s=0.5", "run.settle_s=0.4",
                                  fmt::format("load.T_load_Nm={}", T_load),
                                  fmt::format("plant.theta_e_start_rad={}", theta_e)});
    EXPECT_EQ(locked, 8) << T_load << " Nm";
  }
}

TEST(DirectStart, ThePrintedFilterDoesNotComeToSpeed) {
  for (double theta_e : angles_over_a_turn(3))
    EXPECT_FALSE(reaches_2000_rpm({"estimator.kind=backemf_printed", "load.T_load_Nm=0",
                                   "run.duration_s=0.8", "run.settle_s=0.7",
                                   "controller.foc.synchronism.watch=false",
                                   fmt::format("plant.theta_e_start_rad={}", theta_e)}));
}

TEST(AlignIfStart, TheExtendedEmfComesToSpeedWithALightAndAHeavyRotor) {
  for (const Overrides& rotor : {Overrides{}, kHeavy})
    for (double theta_e : angles_over_a_turn(3))
      EXPECT_TRUE(reaches_2000_rpm(join(
          rotor, {"estimator.kind=eemf", "start=align_if", "load.T_load_Nm=0", "run.duration_s=2.0",
                  "run.settle_s=1.9", fmt::format("plant.theta_e_start_rad={}", theta_e)})))
          << degrees(theta_e) << " deg, " << rotor.size();
}

// Mean currents and torque over the last 0.2 s.
struct Operation {
  Vec2 i_dq = Vec2::Zero();
  double T_em = 0, u = 0, rpm = 0;
};

Operation operation(const Overrides& overrides) {
  ClosedLoop loop(load("kim-ipmsm", overrides));
  Operation o;
  int count = 0;
  for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
    loop.tick();
    if (loop.t_s() < loop.drive().run.duration_s - 0.2) continue;
    ++count;
    o.i_dq += loop.truth().i_dq;
    o.T_em += loop.truth().T_em;
    o.u += loop.measurement().u_alphabeta.norm();
    o.rpm += loop.truth().omega_m * 30 / kPi;
  }
  o.i_dq /= count;
  for (double* sum : {&o.T_em, &o.u, &o.rpm}) *sum /= count;
  return o;
}

TEST(Mtpa, TheDriveNeedsNoMoreThanHalfAPercentMoreCurrentThanTheOptimum) {
  const MachineParameters m = drive_of("kim-ipmsm").machine;
  for (double share : {0.1, 0.5, 1.0}) {
    const Operation o = operation({"reference.speed_rpm=1500", "run.duration_s=0.8",
                                   fmt::format("load.T_load_Nm={}", share * 2.42 - 0.0314)});
    double optimum = 1e9;
    for (double i_d = -3; i_d <= 1; i_d += 1e-4)
      optimum =
          std::min(optimum, std::hypot(i_d, o.T_em / (3 * (m.psi_f - (m.L_q - m.L_d) * i_d))));
    EXPECT_NEAR(o.T_em, share * 2.42, 0.01) << share;
    EXPECT_NEAR(o.i_dq.norm() / optimum, 1, 0.005) << share;
  }
}

TEST(FieldWeakening, GoesBeyondBaseSpeedInsideTheVoltageAndNotWithoutIt) {
  const auto at_3300_rpm = [](bool weakening) {
    return operation({"reference.speed_rpm=3300", "run.duration_s=1.0", "load.T_load_Nm=0.6",

                      fmt::format("controller.foc.field_weakening={}", weakening)});
  };
  const Operation with = at_3300_rpm(true), without = at_3300_rpm(false);
  EXPECT_NEAR(with.rpm, 3300, 10);
  EXPECT_LT(with.u, 0.98 * 311 / std::sqrt(3.0));
  EXPECT_LT(with.i_dq[0], -0.9);
  EXPECT_LT(without.rpm, 3100);
}

TEST(Synchronism, ALostDriveIsReportedAndGoesToZeroVoltage) {
  // Three times the rated torque: the load turns the rotor backwards.
  ClosedLoop loop(load("kim-ipmsm", {"load.T_load_Nm=[[0, 0], [0.3, 7]]", "load.slew_Nm_s=0",
                                     "run.duration_s=0.6"}));
  int reported = 0;
  double at_s = 0;
  for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
    loop.tick();
    if (loop.event().reason != Reason::kLostSynchronism) continue;
    ++reported;
    at_s = loop.t_s();
  }
  EXPECT_EQ(reported, 1);
  EXPECT_GT(at_s, 0.3);
  EXPECT_EQ(loop.command().mode, Mode::kSafe);
  EXPECT_EQ(loop.command().u_alphabeta_ref, Vec2(0, 0));
}

TEST(Synchronism, TheWholePresetRunAndAReversalUnderLoadAreNoFalseAlarm) {
  for (const Overrides& overrides :
       {Overrides{}, Overrides{"reference.speed_rpm=[[0, 2000], [0.4, -2000]]",
                               "load.T_load_Nm=[[0, 0], [0.2, 0.726]]", "run.duration_s=1.0"}}) {
    ClosedLoop loop(load("kim-ipmsm", overrides));
    for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
      loop.tick();
      ASSERT_EQ(loop.event().reason, Reason::kNone) << loop.t_s() << " s";
    }
    EXPECT_LT(degrees(std::abs(loop.angle_error())), 1);
  }
}

}  // namespace
}  // namespace twinrate::test
