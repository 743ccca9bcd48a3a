// The state machine in the simulated plant: what is off, when, and what the motor does then.
#include <gtest/gtest.h>

#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::plant_safety_test {
namespace {

using test::Overrides;

Plant ideal(Overrides overrides = {}) {
  overrides.insert(overrides.begin(),
                   {"sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0", "plant.erk_steps=4"});
  return test::plant_of(test::load("dilys2021", overrides));
}

void tick(Plant& plant, const Vec2& u, Mode mode = Mode::kRun) {
  plant.take_command({.k = plant.k(), .mode = mode, .u_alphabeta_ref = u});
  plant.advance();
}

Reason trip_of(const Plant& plant) {
  for (int i = 0; i < plant.safety().event_count(); ++i)
    if (is_trip(plant.safety().event(i).reason)) return plant.safety().event(i).reason;
  return Reason::kNone;
}

// Ticks until it is off, at most `most`; the reason in `why`.
int ticks_until_off(Plant& plant, const Vec2& u, int most, Reason& why) {
  for (int k = 1; k <= most; ++k) {
    tick(plant, u);
    if (plant.tripped()) {
      why = trip_of(plant);
      return k;
    }
  }
  return -1;
}

double amplitude(const Plant& plant) {
  return plant.truth().i_dq.norm();
}

// 4 i_rated = 6 A. A locked rotor under 12 V would reach 10 A.
TEST(PlantSafety, ALockedRotorIsOffAtTheSecondSampleAboveTheTripCurrent) {
  Plant plant = ideal({"machine.J_kgm2=1e4"});
  int above = 0;
  while (!plant.tripped() && plant.k() < 100) {
    if (amplitude(plant) > 6) ++above;
    tick(plant, {12, 0});
  }
  EXPECT_EQ(trip_of(plant), Reason::kOverCurrent);
  EXPECT_EQ(above, 2);
  for (int k = 0; k < 50; ++k) tick(plant, {12, 0});
  EXPECT_LT(amplitude(plant), 1e-3);
  EXPECT_EQ(plant.sample().mode, Mode::kSafe);
}

TEST(PlantSafety, TheTripCurrentIsTheDriveFilesOrFollowsFromMachineAndController) {
  EXPECT_NEAR(ideal().safety().limits().i_trip, 6, 1e-9);
  EXPECT_NEAR(ideal({"machine.i_trip_A=8"}).safety().limits().i_trip, 8, 1e-12);
  EXPECT_NEAR(ideal({"controller.foc.i_max_A=10"}).safety().limits().i_trip, 20, 1e-12);
}

TEST(PlantSafety, ABusOutOfItsLimitsIsOffAtOnce) {
  for (const auto& [volts, reason] :
       {std::pair("35", Reason::kOverVoltage), std::pair("8", Reason::kUnderVoltage)}) {
    Plant plant = ideal({"plant.fault.kind=bus_voltage", "plant.fault.at_s=0.01",
                         std::string("plant.fault.value=") + volts});
    Reason why = Reason::kNone;
    // The bus changes in the interval from t_50; t_51 sees it.
    EXPECT_EQ(ticks_until_off(plant, {1, 0}, 100, why), 52);
    EXPECT_EQ(why, reason);
  }
}

// A locked rotor at 2 A, 4/3 of the rated current: the winding rises by 80 K (4/3)^2 = 142 K.
Overrides hot(Overrides more = {}) {
  Overrides list = {"machine.J_kgm2=1e4", "safety.temperature_max_degC=120",
                    "plant.winding.tau_s=0.1"};
  list.insert(list.end(), more.begin(), more.end());
  return list;
}

TEST(PlantSafety, AWindingWarmsByItsCopperLossAndDeratesTheCurrentWithinATick) {
  Plant plant = ideal(hot());
  const Vec2 u(2.4, 0);
  double before = 0;
  while (plant.safety().state() != DriveState::kDerate && plant.k() < 5000) {
    before = plant.winding_temperature();
    tick(plant, u);
  }
  // exp(-t/tau) = 1 - 75/142.2; the current itself is there after 1 ms.
  EXPECT_NEAR(static_cast<double>(plant.k()) * 2e-4, 0.1 * -std::log(1 - 75 / 142.2), 2e-3);
  EXPECT_GE(before, 100);
  EXPECT_LT(before, 100.2);
  EXPECT_EQ(plant.safety().event(0).reason, Reason::kDerated);
  for (int k = 0; k < 5000; ++k) tick(plant, u);
  // Where the current that is left, 3 A (120 - T)/20, holds the temperature: T = 25 + 80 (i/1.5)^2.
  const double T = plant.winding_temperature(), i = 3 * (120 - T) / 20;
  EXPECT_NEAR(T, 25 + 80 * i * i / 2.25, 0.5);
  EXPECT_NEAR(amplitude(plant), i, 0.01);
  EXPECT_LT(amplitude(plant), 1.7);
  EXPECT_FALSE(plant.tripped());
  EXPECT_NEAR(plant.sample().u_alphabeta[0], 1.2 * i, 0.05) << "what was applied is reported";
}

// Ticks of 0.2 ms: a stop planned for tick 50, a reset for tick 100.
TEST(PlantSafety, APlannedStopAndResetActAtTheirTicks) {
  Plant plant = ideal({"steering.emergency=[[0.0,\"none\"],[0.01,\"stop\"],[0.02,\"reset\"]]"});
  std::int64_t off_at = -1, on_at = -1;
  while (plant.k() < 200) {
    tick(plant, {0.1, 0});
    const bool off = plant.safety().state() == DriveState::kSafe;
    if (off && off_at < 0) off_at = plant.k();
    if (!off && off_at >= 0 && on_at < 0) on_at = plant.k();
  }
  EXPECT_EQ(off_at, 51) << "off before the plant leaves tick 50";
  EXPECT_EQ(on_at, 101) << "on with tick 100";
}

// An interior-magnet motor at 100 rad/s electrical on a constant voltage in rotor axes, hot: half of its current is left. Each command
// acts one tick later; every `every`th one arrives.
double derated_current(int every) {
  Config config = test::load(
      "kim-ipmsm", {"sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0", "machine.J_kgm2=1e4",
                    "start=flying", "reference.speed_rpm=480", "safety.temperature_max_degC=120",
                    "plant.fault.kind=temperature", "plant.fault.value=110", "plant.fault.at_s=0",
                    "safety.watch_sensors=false", "safety.hold_ms=100"});
  const double n_p = config.drive().machine.n_p, T_s = config.drive().T_s();
  Plant plant = test::plant_of(std::move(config));
  double largest = 0;
  for (int k = 0; k < 3000; ++k) {
    const double theta_e = n_p * plant.truth().theta_m;
    const double turned = n_p * plant.truth().omega_m * T_s;
    if (k % every == 0)
      plant.take_command({.k = plant.k(),
                          .mode = Mode::kRun,
                          .u_alphabeta_ref = inverse_park({-60, 60}, theta_e + 1.5 * turned),
                          .theta_ctrl = theta_e});
    plant.advance();
    if (k > 2000) largest = std::max(largest, plant.truth().i_dq.norm());
  }
  EXPECT_EQ(plant.safety().state(), DriveState::kDerate);
  return largest / plant.safety().limits().i_derate;
}

TEST(PlantSafety, ADeratedSalientMotorKeepsTheLimitWhileItTurns) {
  EXPECT_NEAR(derated_current(1), 0.5, 1e-5);
  EXPECT_NEAR(derated_current(2), 0.5, 1e-5) << "two ticks since the command before";
}

TEST(PlantSafety, ATemperatureAboveItsLimitIsOffAtOnce) {
  Plant plant = ideal(
      hot({"plant.fault.kind=temperature", "plant.fault.at_s=0.01", "plant.fault.value=120.1"}));
  Reason reason = Reason::kNone;
  EXPECT_EQ(ticks_until_off(plant, {1, 0}, 100, reason), 51);
  EXPECT_EQ(reason, Reason::kOverTemperature);
  EXPECT_NE(plant.reset(), "") << "still hot";
  Plant not_watched = ideal({"plant.fault.kind=temperature", "plant.fault.value=500"});
  Reason why = Reason::kNone;
  EXPECT_EQ(ticks_until_off(not_watched, {1, 0}, 100, why), -1);
}

TEST(PlantSafety, ALoadThatDrivesTheMotorEndsInOverSpeed) {
  Plant plant = ideal({"start=flying", "load.T_load_Nm=-0.2", "load.slew_Nm_s=0",
                       "safety.omega_m_max_rad_s=300", "machine.psi_f_Wb=1e-6"});
  double beyond_since = -1;
  while (!plant.tripped() && plant.k() < 5000) {
    if (plant.truth().omega_m > 300 && beyond_since < 0)
      beyond_since = static_cast<double>(plant.k()) * 2e-4;
    tick(plant, {0, 0});
  }
  EXPECT_EQ(trip_of(plant), Reason::kOverSpeed);
  ASSERT_GT(beyond_since, 0);
  EXPECT_LE(static_cast<double>(plant.k()) * 2e-4 - beyond_since, 10e-3);
}

TEST(PlantSafety, ACommandThatIsNotFiniteIsHeldOnceAndOffAtTheSecond) {
  Plant plant = ideal({"machine.J_kgm2=1e4"});
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (int k = 0; k < 5; ++k) tick(plant, {3, 0});
  tick(plant, {nan, 0});
  tick(plant, {3, 0});  // the command of the last tick acts now, and is held
  EXPECT_NEAR(plant.sample().u_alphabeta[0], 3, 1e-12);
  EXPECT_FALSE(plant.tripped());
  tick(plant, {nan, 0});
  tick(plant, {nan, 0});
  EXPECT_FALSE(plant.tripped());
  tick(plant, {3, 0});
  EXPECT_EQ(trip_of(plant), Reason::kCommandNotFinite);
}

TEST(PlantSafety, OffIsHoldMillisecondsAfterTheTickOfTheLastCommandWhateverTheDelay) {
  for (const int delay : {0, 1, 3}) {
    Plant plant = ideal({"safety.hold_ms=3", "plant.delay_samples=" + std::to_string(delay)});
    constexpr int kLast = 9;  // COMMAND(9) is the last one
    for (int k = 0; k <= kLast; ++k) tick(plant, {1, 0});
    while (!plant.tripped() && plant.k() < 100) plant.advance();
    // The interval that begins at t_24 = t_9 + 3 ms is the first that is off.
    EXPECT_EQ(plant.k() - 1, kLast + 15) << delay;
    EXPECT_EQ(trip_of(plant), Reason::kCommandLost);
  }
}

TEST(PlantSafety, ACommandForSafeModeIsOff) {
  Plant plant = ideal();
  for (int k = 0; k < 5; ++k) tick(plant, {1, 0});
  tick(plant, {1, 0}, Mode::kSafe);
  EXPECT_FALSE(plant.tripped());  // it acts a tick later
  tick(plant, {1, 0});
  EXPECT_EQ(trip_of(plant), Reason::kSafeRequested);
}

TEST(PlantSafety, AResetTakesItBackToCommands) {
  Plant plant = ideal();
  for (int k = 0; k < 5; ++k) tick(plant, {1, 0});
  EXPECT_NE(plant.reset(), "");
  plant.emergency_stop();
  for (int k = 0; k < 5; ++k) tick(plant, {1, 0});
  EXPECT_EQ(plant.sample().u_alphabeta, Vec2(0, 0));
  EXPECT_EQ(plant.reset(), "");
  tick(plant, {1, 0});
  ASSERT_EQ(plant.safety().event_count(), 2);
  EXPECT_EQ(plant.safety().event(0).reason, Reason::kReset);
  for (int k = 0; k < 2; ++k) tick(plant, {1, 0});
  EXPECT_EQ(plant.safety().state(), DriveState::kRun);
  EXPECT_NEAR(plant.sample().u_alphabeta[0], 1, 1e-12);
}

TEST(PlantSafety, AResetActsAtItsTickAndWaitsInIdleForACommandThatIsNotSafeMode) {
  Plant plant = ideal();
  for (int k = 0; k < 5; ++k) tick(plant, {1, 0}, k < 2 ? Mode::kRun : Mode::kSafe);
  ASSERT_TRUE(plant.tripped());
  EXPECT_EQ(plant.reset(8), "");
  for (int k = 5; k < 8; ++k) tick(plant, {1, 0}, Mode::kSafe);
  EXPECT_TRUE(plant.tripped());
  for (int k = 8; k < 50; ++k) tick(plant, {1, 0}, Mode::kSafe);
  EXPECT_EQ(plant.safety().state(), DriveState::kIdle);
  EXPECT_EQ(plant.sample().u_alphabeta, Vec2(0, 0));
  for (int k = 0; k < 2; ++k) tick(plant, {1, 0});
  EXPECT_EQ(plant.safety().state(), DriveState::kRun);
}

// EMF between two phases at 100 rad/s: sqrt3 0.007 400 = 4.85 V.
class Coasting : public testing::Test {
 protected:
  Plant off(const std::string& how, const std::string& v_dc, const Vec2& u = {0, 0}) {
    Plant plant = ideal({"start=flying", "safety.off=" + how, "inverter.v_dc_V=" + v_dc});
    for (int k = 0; k < 3; ++k) tick(plant, u);
    plant.emergency_stop();
    return plant;
  }
};

TEST_F(Coasting, WithOpenGatesBelowTheBusVoltageTheCurrentEndsAndOnlyFrictionBrakes) {
  Plant plant = off("open", "24", {3, 0});
  ASSERT_GT(amplitude(plant), 0.5);
  for (int k = 0; k < 10; ++k) tick(plant, {3, 0});
  EXPECT_EQ(amplitude(plant), 0);
  const double omega_m = plant.truth().omega_m;
  for (int k = 0; k < 500; ++k) tick(plant, {3, 0});
  EXPECT_EQ(amplitude(plant), 0);
  EXPECT_NEAR(plant.truth().omega_m, omega_m * std::exp(-1e-5 / 1e-5 * 0.1), 1e-5 * omega_m);
  EXPECT_EQ(plant.sample().signals & kVoltage, 0) << "nobody knows the voltage of open gates";
}

TEST_F(Coasting, WithShortedPhasesTheMotorBrakesOnItsResistance) {
  Plant plant = off("short", "24");
  for (int k = 0; k < 10; ++k) tick(plant, {0, 0});
  // i = omega_e psi_f/|Z| with |Z| = sqrt(R_s^2 + (omega_e L)^2)
  const Truth t = plant.truth();
  const double omega_e = 4 * t.omega_m;
  EXPECT_NEAR(t.i_dq.norm(), omega_e * 0.007 / std::hypot(1.2, omega_e * 5e-4), 0.15);
  EXPECT_LT(t.T_em, -0.05);
}

// Three phases into a bus of 3 V: the diodes conduct, the motor is a generator.
TEST_F(Coasting, WithOpenGatesAboveTheBusVoltageTheDiodesRectify) {
  Plant plant = off("open", "3");
  double charge = 0;
  for (int k = 0; k < 20; ++k) {
    tick(plant, {0, 0});
    charge += amplitude(plant);
    EXPECT_LE(plant.truth().T_em, 1e-6) << "it brakes";
  }
  EXPECT_GT(charge, 1);
  for (int k = 0; k < 500; ++k) tick(plant, {0, 0});
  EXPECT_LT(std::numbers::sqrt3 * 0.007 * 4 * plant.truth().omega_m, 3.0);
  EXPECT_EQ(amplitude(plant), 0) << "below the bus voltage the diodes block";
}

TEST(PlantSafety, AHealthyRowPassesTheWatchBitForBit) {
  Plant watched = ideal({"start=flying"}),
        blind = ideal({"start=flying", "safety.watch_sensors=false"});
  for (int k = 0; k < 500; ++k) {
    const Vec2 u = 3 * Vec2(std::cos(0.08 * k), std::sin(0.08 * k));
    tick(watched, u);
    tick(blind, u);
    ASSERT_EQ(watched.sample().i_abc, blind.sample().i_abc) << k;
    ASSERT_EQ(watched.sample().signals, blind.sample().signals) << k;
  }
}

}  // namespace
}  // namespace twinrate::plant_safety_test
