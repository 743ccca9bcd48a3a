#include "plant_sim/switched_inverter.hpp"

#include <gtest/gtest.h>

#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::switched_inverter_test {
namespace {

constexpr double kTpwm = 1e-4, kDead = 1e-6, kVdc = 235.4;

Vec2 mean_voltage(SwitchedInverter& inverter, const Vec3& duty_abc, const Vec3& i_abc) {
  Vec2 sum = Vec2::Zero();
  for (const Segment& s : inverter.next_period(duty_abc))
    sum += s.T * s.states.u_alphabeta(i_abc, kVdc);
  return sum / kTpwm;
}

TEST(SwitchedInverter, HasThirteenSegmentsThatFillThePeriodAndSevenWithoutDeadTime) {
  SwitchedInverter inverter(kTpwm, kDead, 0.01), ideal(kTpwm, 0, 0.01);
  const Vec3 duty(0.3, 0.5, 0.62);
  for (int period = 0; period < 3; ++period) {
    const auto segments = inverter.next_period(duty);
    EXPECT_EQ(segments.size(), 13u);
    double t = 0;
    for (const Segment& s : segments) {
      EXPECT_NEAR(s.t_start, t, 1e-18);
      EXPECT_GT(s.T, 0);
      t += s.T;
    }
    EXPECT_NEAR(t, kTpwm, 1e-18);
  }
  EXPECT_EQ(ideal.next_period(duty).size(), 7u);
}

// The upper switch opens at 0.99 T; 2 % of T dead then end at 0.01 T of the next period.
TEST(SwitchedInverter, ADeadTimeRunsOnIntoTheNextPeriod) {
  SwitchedInverter inverter(kTpwm, 0.02 * kTpwm, 0.01);
  inverter.next_period(Vec3(0.98, 0.5, 0.5));
  double dead = 0;
  for (const Segment& s : inverter.next_period(Vec3(0.2, 0.5, 0.5))) {
    if (s.t_start >= 0.3 * kTpwm) break;
    if (s.states.legs[0] == Leg::kDead) dead += s.T;
  }
  EXPECT_NEAR(dead, 0.01 * kTpwm, 1e-9 * kTpwm);
}

TEST(SwitchedInverter, LosesDeadTimeTimesSignOfTheCurrentInEachLeg) {
  SwitchedInverter inverter(kTpwm, kDead, 0.01);
  const Vec3 duty(0.3, 0.5, 0.62);
  for (const Vec3& i_abc : {Vec3(5, -2, -3), Vec3(-5, 2, 3), Vec3(-1, -1, 2)}) {
    const Vec3 sign(i_abc[0] > 0 ? 1 : -1, i_abc[1] > 0 ? 1 : -1, i_abc[2] > 0 ? 1 : -1);
    const Vec2 expected = clarke(duty * kVdc - kDead / kTpwm * kVdc * sign);
    EXPECT_NEAR((mean_voltage(inverter, duty, i_abc) - expected).norm(), 0, 1e-9);
  }
}

TEST(SwitchedInverter, LosesNothingInALegWithoutCurrent) {
  SwitchedInverter inverter(kTpwm, kDead, 0.01);
  const Vec3 duty(0.3, 0.5, 0.62);
  const Vec2 expected = clarke(duty * kVdc);
  EXPECT_NEAR((mean_voltage(inverter, duty, Vec3::Zero()) - expected).norm(), 0, 1e-9);
}

TEST(SwitchedInverter, ALegAtZeroOrOneDoesNotSwitchAndPaysOnceForGettingThere) {
  SwitchedInverter inverter(kTpwm, kDead, 0.01);
  const Vec3 i_abc(5, -2, -3);  // phase a positive, b and c negative: their dead time is high
  const auto a = [&](const Vec3& duty) { return mean_voltage(inverter, duty, i_abc); };
  const Vec3 rails(1, 0, 0);
  // From low to high in leg a: one dead time, then none.
  EXPECT_NEAR(a(rails)[0], 2.0 / 3 * kVdc * (1 - kDead / kTpwm), 1e-9);
  EXPECT_NEAR(a(rails)[0], 2.0 / 3 * kVdc, 1e-9);
  EXPECT_NEAR(a(rails)[0], 2.0 / 3 * kVdc, 1e-9);
  // Down again: a falls at once (positive current), b rises to the middle of the period.
  EXPECT_NEAR(a(Vec3(0, 0, 0)).norm(), 0, 1e-9);
}

TEST(SwitchedInverter, APulseShorterThanTheDeadTimeNeverTurnsOnItsSwitch) {
  SwitchedInverter inverter(kTpwm, kDead, 0.01);
  const Vec3 duty(0.005, 0.5, 0.5);  // 0.5 us high
  for (const Segment& s : inverter.next_period(duty))
    EXPECT_NE(s.states.legs[0], Leg::kHigh) << s.t_start;
  // The other way round: a low pulse of 0.5 us over the period's border stays dead.
  inverter.next_period(Vec3(0.995, 0.5, 0.5));
  for (const Segment& s : inverter.next_period(Vec3(0.995, 0.5, 0.5)))
    EXPECT_NE(s.states.legs[0], Leg::kLow) << s.t_start;
}

Plant locked(const std::string& inverter, const std::string& more = "",
             const test::Overrides& overrides = {}) {
  return test::plant_of(
      Config::parse("preset = \"dilys2021\"\n[machine]\nJ_kgm2 = 1e4\nL_d_H = 20e-3\n"
                    "L_q_H = 20e-3\n[sensors]\ni_noise_rms_A = 0.0\ni_lsb_A = 0.0\n[plant]\n"
                    "delay_samples = 0\ninverter = \"" +
                        inverter + "\"\n" + more,
                    "drive.toml", overrides));
}

void tick(Plant& plant, const Vec2& u) {
  plant.take_command({.k = plant.k(), .u_alphabeta_ref = u});
  ASSERT_TRUE(plant.advance());
}

TEST(SwitchedPlant, WithoutDeadTimeEqualsTheAveragedOneAtTheSamplingInstants) {
  Plant switched = locked("switched"), averaged = locked("averaged");
  double worst = 0;
  for (int k = 0; k < 400; ++k) {
    const Vec2 u(6 * std::sin(0.05 * k), 4 * std::cos(0.11 * k));
    tick(switched, u);
    tick(averaged, u);
    worst = std::max(worst, (switched.truth().i_dq - averaged.truth().i_dq).norm());
  }
  // The ripple itself is v_dc T_pwm/(8 L) = 30 mA.
  EXPECT_LT(worst, 3e-4);
  EXPECT_GT(worst, 1e-9) << "the same inverter twice?";
}

TEST(SwitchedPlant, TheSwitchedTurningDriveEqualsTheAveragedOne) {
  const auto drive = [](const char* inverter) {
    return test::plant_of(test::load(
        "dilys2021", {"start=flying", "sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0",
                      "inverter.f_pwm_Hz=20000", fmt::format("plant.inverter={}", inverter)}));
  };
  Plant switched = drive("switched"), averaged = drive("averaged");
  for (int k = 0; k < 500; ++k) {
    const Vec2 u = inverse_park({-0.3, 2.9}, 400 * (k + 0.5) * 2e-4);
    tick(switched, u);
    tick(averaged, u);
  }
  EXPECT_NEAR(switched.truth().omega_m, averaged.truth().omega_m, 0.02);
  EXPECT_NEAR((switched.truth().i_dq - averaged.truth().i_dq).norm(), 0, 0.02);
  EXPECT_GT(averaged.truth().i_dq.norm(), 0.05);
}

// Voltage loss of phase a by the dead time, locked rotor in steady state.
double steady_loss(double u_a) {
  Plant plant = locked("switched", "[[effect]]\nkind = \"dead_time\"\ndead_time_s = 4e-6\n");
  for (int k = 0; k < 1200; ++k) tick(plant, {u_a, 0});
  return u_a - 1.2 * plant.truth().i_dq[0];
}

TEST(SwitchedPlant, DeadTimeCostsItsFullVoltageAtLargeCurrentAndLittleNearZero) {
  const double full = 4.0 / 3 * 4e-6 * 5000 * 24;  // 0.64 V
  EXPECT_NEAR(steady_loss(5), full, 0.01 * full);
  EXPECT_NEAR(steady_loss(-5), -full, 0.01 * full);
  // Below the loss the current is nearly zero: the loss is nearly the whole voltage.
  const double small = steady_loss(0.2);
  EXPECT_GT(small, 0);
  EXPECT_LT(small, 0.2);
  EXPECT_LT((0.2 - small) / 1.2, 0.02) << "current, A";
  EXPECT_NEAR(steady_loss(0), 0, 1e-3);
}

TEST(SwitchedPlant, OneStepASegmentIsWithinATenthOfAMilliampereOfTheReferee) {
  const auto drive = [](const char* engine) {
    return locked("switched", "[[effect]]\nkind = \"dead_time\"\ndead_time_s = 2e-6\n",
                  {fmt::format("plant.engine={}", engine)});
  };
  Plant erk = drive("erk"), cvode = drive("cvode");
  double worst = 0;
  for (int k = 0; k < 150; ++k) {
    const Vec2 u(4 * std::sin(0.1 * k), 4 * std::cos(0.1 * k));  // every phase crosses zero
    tick(erk, u);
    tick(cvode, u);
    worst = std::max(worst, (erk.truth().i_dq - cvode.truth().i_dq).norm());
  }
  EXPECT_LT(worst, 1e-4);
  EXPECT_GT(worst, 1e-12);
}

TEST(SwitchedPlant, EnergyOfTheLegsIsCopperPlusStored) {
  const MachineParameters m{
      .R_s = 1.2, .L_d = 5e-3, .L_q = 8e-3, .psi_f = 0.05, .J = 1e-4, .B = 1e-3, .n_p = 4};
  const DriveModel model(m, {}, 24);
  const auto integrator = make_integrator(Engine::kErk, model, 1);
  SwitchedInverter inverter(kTpwm, 2e-6, 0.5 * 24 * 2e-6 / 5e-3);
  const auto stored = [&](const PlantState& x) {
    return 0.75 * (m.L_d * x[0] * x[0] + m.L_q * x[1] * x[1]) + 0.5 * m.J * x[2] * x[2];
  };
  PlantState x(0, 0, 10, 0.1);
  const double stored_before = stored(x);
  double in = 0, out = 0, dead_work = 0;
  for (int period = 0; period < 100; ++period) {
    const Vec3 duty(0.5 + 0.3 * std::sin(0.1 * period), 0.5 - 0.2 * std::sin(0.1 * period), 0.45);
    for (const Segment& segment : inverter.next_period(duty)) {
      PlantInput input;
      input.legs = segment.states;
      // Simpson over twenty pieces of the segment.
      constexpr int kPieces = 20;
      const double h = segment.T / kPieces;
      for (int piece = 0; piece < kPieces; ++piece) {
        const PlantState middle = integrator->advance(x, input, h / 2);
        const PlantState next = integrator->advance(x, input, h);
        const auto add = [&](const PlantState& s, double weight) {
          const Vec2 i_alphabeta = inverse_park(s.head<2>(), 4 * s[3]);
          const Vec2 u = segment.states.u_alphabeta(inverse_clarke(i_alphabeta), 24);
          const double power = 1.5 * u.dot(i_alphabeta);
          in += weight * power;
          for (Leg leg : segment.states.legs)
            if (leg == Leg::kDead) dead_work += std::abs(weight * power) / 3;
          out += weight * (1.5 * m.R_s * s.head<2>().squaredNorm() + m.B * s[2] * s[2]);
        };
        add(x, h / 6), add(middle, 4 * h / 6), add(next, h / 6);
        x = next;
      }
    }
  }
  EXPECT_NEAR(in, out + stored(x) - stored_before, 1e-5 * std::abs(in));
  EXPECT_GT(dead_work, 1e-3 * std::abs(in)) << "dead legs took no part";
}

TEST(SwitchedPlant, ALegThatReachesZeroCurrentInDeadTimeStaysThere) {
  // Leg a dead for a long time, b and c low: its current decays to zero and does not turn round.
  const MachineParameters m{
      .R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e4, .B = 0, .n_p = 4};
  const DriveModel model(m, {}, 24);
  const auto integrator = make_integrator(Engine::kErk, model, 1);
  PlantInput input;
  input.legs = LegStates{{Leg::kDead, Leg::kLow, Leg::kHigh}, 0.5 * 24 * 1e-6 / 5e-4};
  PlantState x(0.1, 0, 0, 0);
  double lowest = 0.1;
  for (int step = 0; step < 60; ++step) {
    x = integrator->advance(x, input, 1e-6);
    lowest = std::min(lowest, x[0]);
  }
  EXPECT_NEAR(x[0], 0, 1e-3);
  EXPECT_GT(lowest, -1e-3);
  EXPECT_GT(std::abs(x[1]), 0.5) << "the other two legs go on";
}

TEST(SwitchedPlant, NeedsWholeSwitchingPeriodsATick) {
  try {
    locked("switched", "[inverter]\nf_pwm_Hz = 7000.0\n");
    FAIL() << "accepted";
  } catch (const BadInput& error) {
    EXPECT_NE(std::string(error.what()).find("whole number of switching periods"),
              std::string::npos)
        << error.what();
  }
  EXPECT_NO_THROW(locked("switched", "[inverter]\nf_pwm_Hz = 15000.0\n"));
}

}  // namespace
}  // namespace twinrate::switched_inverter_test
