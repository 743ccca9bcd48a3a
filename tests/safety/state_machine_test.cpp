// Each row of the table of faults, on the state machine alone.
#include "safety/state_machine.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <ostream>
#include <vector>

namespace twinrate::state_machine_test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

SafetyLimits limits() {
  SafetyLimits l;
  l.T_s = 2e-4;
  l.i_trip = 6;
  l.v_dc_max = 30;
  l.v_dc_min = 12;
  l.omega_m_max = 800;
  l.temperature_derate = 80;
  l.temperature_max = 100;
  l.hold_ticks = 20;
  l.sensor_ticks = 50;
  return l;
}

SafetyInput running() {
  SafetyInput in;
  in.arrival = Arrival::kInTime;
  in.i = 1;
  in.v_dc = 24;
  in.omega_m = 100;
  return in;
}

SafetyMachine machine_in_run() {
  SafetyMachine machine(limits());
  for (int k = 0; k < 10; ++k) machine.step(running());
  EXPECT_EQ(machine.state(), DriveState::kRun);
  return machine;
}

// The reason of the only event that left the machine in SAFE.
Reason reason_of_trip(const SafetyMachine& machine) {
  for (int i = 0; i < machine.event_count(); ++i)
    if (machine.event(i).to == DriveState::kSafe) return machine.event(i).reason;
  return Reason::kNone;
}

struct Row {
  const char* name;
  Fault fault;
  int ticks;  // of the fault until it is off, the first one included
  std::function<void(SafetyInput&)> make;
};
void PrintTo(const Row& row, std::ostream* out) {
  *out << row.name;
}

const std::vector<Row> kRows = {
    {"EmergencyStop", Fault::kEmergencyStop, 1, [](auto& in) { in.emergency_stop = true; }},
    {"OverCurrent", Fault::kOverCurrent, 2, [](auto& in) { in.i = 6.01; }},
    {"CurrentNan", Fault::kOverCurrent, 2, [](auto& in) { in.i = kNan; }},
    {"OverVoltage", Fault::kOverVoltage, 1, [](auto& in) { in.v_dc = 30.1; }},
    {"UnderVoltage", Fault::kUnderVoltage, 1, [](auto& in) { in.v_dc = 11.9; }},
    {"OverTemperature", Fault::kOverTemperature, 1,
     [](auto& in) { in.has_temperature = true, in.temperature = 101; }},
    {"TemperatureNan", Fault::kOverTemperature, 1,
     [](auto& in) { in.has_temperature = true, in.temperature = kNan; }},
    {"SensorLost", Fault::kSensorLost, 51, [](auto& in) { in.faulty = 1; }},
    {"CommandNotFinite", Fault::kCommandNotFinite, 2,
     [](auto& in) { in.arrival = Arrival::kNotFinite; }},
    {"CommandLost", Fault::kCommandLost, 21, [](auto& in) { in.arrival = Arrival::kMissing; }},
    {"SupervisorLost", Fault::kSupervisorLost, 1, [](auto& in) { in.supervisor_silent = true; }},
    {"SafeRequested", Fault::kSafeRequested, 1, [](auto& in) { in.asked = Asked::kSafe; }},
};

class SafetyRow : public testing::TestWithParam<Row> {};

TEST_P(SafetyRow, GoesOffWithinItsTicksWithItsReasonAndStaysOff) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  GetParam().make(in);
  for (int tick = 1; tick < GetParam().ticks; ++tick) {
    machine.step(in);
    ASSERT_FALSE(machine.is_off()) << "after " << tick;
  }
  machine.step(in);
  ASSERT_TRUE(machine.is_off());
  EXPECT_EQ(reason_of_trip(machine), kFaults[static_cast<std::size_t>(GetParam().fault)].reason);
  EXPECT_TRUE(is_trip(reason_of_trip(machine)));
  for (int tick = 0; tick < 100; ++tick) {
    machine.step(running());
    ASSERT_TRUE(machine.is_off()) << "latched";
    EXPECT_EQ(machine.event_count(), 0);
  }
}

class PatientRow : public testing::TestWithParam<Row> {};

TEST_P(PatientRow, AFaultThatEndsOneTickSoonerIsNoTrip) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  GetParam().make(in);
  for (int round = 0; round < 5; ++round) {
    for (int tick = 1; tick < GetParam().ticks; ++tick) machine.step(in);
    machine.step(running());
    ASSERT_FALSE(machine.is_off());
  }
}

// After a reset the ticks of a fault count from zero again.
TEST_P(PatientRow, AfterAResetTheSameFaultNeedsAllItsTicksAgain) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  GetParam().make(in);
  for (int tick = 0; tick < GetParam().ticks; ++tick) machine.step(in);
  ASSERT_TRUE(machine.is_off());
  machine.step(running());
  ASSERT_TRUE(machine.reset());
  for (int tick = 1; tick < GetParam().ticks; ++tick) {
    machine.step(in);
    ASSERT_FALSE(machine.is_off()) << "after " << tick;
  }
}

TEST_P(SafetyRow, EachFaultHasItsOwnOff) {
  for (const Off off : {Off::kShort, Off::kOpen}) {
    SafetyLimits l = limits();
    l.off.fill(off == Off::kShort ? Off::kOpen : Off::kShort);
    l.off[static_cast<std::size_t>(GetParam().fault)] = off;
    SafetyMachine machine(l);
    for (int k = 0; k < 10; ++k) machine.step(running());
    SafetyInput in = running();
    GetParam().make(in);
    for (int tick = 0; tick < GetParam().ticks; ++tick) machine.step(in);
    ASSERT_TRUE(machine.is_off());
    EXPECT_EQ(machine.off(), off);
  }
}

INSTANTIATE_TEST_SUITE_P(Table, SafetyRow, testing::ValuesIn(kRows),
                         [](const auto& row) { return row.param.name; });

std::vector<Row> patient_rows() {
  std::vector<Row> rows;
  for (const Row& row : kRows)
    if (row.ticks > 1) rows.push_back(row);
  return rows;
}
INSTANTIATE_TEST_SUITE_P(Table, PatientRow, testing::ValuesIn(patient_rows()),
                         [](const auto& row) { return row.param.name; });

TEST(SafetyMachine, EveryFaultHasARowInItsOrderAndATest) {
  for (std::size_t i = 0; i < kFaultCount; ++i) {
    EXPECT_EQ(static_cast<std::size_t>(kFaults[i].fault), i);
    bool tested = kFaults[i].fault == Fault::kOverSpeed;  // below
    for (const Row& row : kRows) tested = tested || row.fault == kFaults[i].fault;
    EXPECT_TRUE(tested) << kFaults[i].key;
  }
}

TEST(SafetyMachine, OverSpeedIsOffWithinTenMilliseconds) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  in.omega_m = -820;  // 2.5 % beyond
  int ticks = 0;
  while (!machine.is_off() && ticks < 1000) machine.step(in), ++ticks;
  EXPECT_EQ(reason_of_trip(machine), Reason::kOverSpeed);
  EXPECT_LE(ticks * 2e-4, 10e-3);
  EXPECT_GT(ticks, 1);
}

// An encoder of 64 counts at 5 kHz: its speed is 0 or 491 rad/s, at a true speed of 400.
TEST(SafetyMachine, TheSpeedOfACoarseEncoderIsAveraged) {
  SafetyLimits l = limits();
  l.omega_m_max = 470;
  SafetyMachine machine(l);
  double theta = 0, counted = 0;
  for (int k = 0; k < 5000; ++k) {
    theta += 400 * 2e-4;
    const double now = std::floor(theta / 0.0982) * 0.0982;
    SafetyInput in = running();
    in.omega_m = (now - counted) / 2e-4;
    counted = now;
    machine.step(in);
  }
  EXPECT_FALSE(machine.is_off());
}

TEST(SafetyMachine, FollowsTheCommandFromIdleThroughAlignToRun) {
  SafetyMachine machine(limits());
  SafetyInput in = running();
  in.arrival = Arrival::kNotDue;
  machine.step(in);
  EXPECT_EQ(machine.state(), DriveState::kIdle);
  EXPECT_EQ(machine.event_count(), 0);
  in.arrival = Arrival::kInTime;
  in.asked = Asked::kForcedAngle;
  machine.step(in);
  EXPECT_EQ(machine.state(), DriveState::kAlign);
  ASSERT_EQ(machine.event_count(), 1);
  EXPECT_EQ(machine.event(0).reason, Reason::kStateChange);
  EXPECT_EQ(machine.event(0).from, DriveState::kIdle);
  machine.step(in);
  EXPECT_EQ(machine.event_count(), 0);
  in.asked = Asked::kRun;
  machine.step(in);
  EXPECT_EQ(machine.state(), DriveState::kRun);
  EXPECT_EQ(machine.event_count(), 1);
}

TEST(SafetyMachine, IdleWaitsForTheFirstCommand) {
  SafetyMachine machine(limits());
  SafetyInput in = running();
  in.arrival = Arrival::kMissing;
  for (int k = 0; k < 1000; ++k) machine.step(in);
  EXPECT_EQ(machine.state(), DriveState::kIdle);
  machine.step(running());
  EXPECT_EQ(machine.state(), DriveState::kRun);
}

TEST(SafetyMachine, DeratesOverTemperatureAndComesBack) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  in.has_temperature = true;
  in.temperature = 90;
  machine.step(in);
  EXPECT_EQ(machine.state(), DriveState::kDerate);
  ASSERT_EQ(machine.event_count(), 1);
  EXPECT_EQ(machine.event(0).reason, Reason::kDerated);
  EXPECT_NEAR(machine.current_share(), 0.5, 1e-12);
  in.temperature = 79;  // above the hysteresis
  machine.step(in);
  EXPECT_EQ(machine.state(), DriveState::kDerate);
  in.temperature = 77;
  machine.step(in);
  EXPECT_EQ(machine.state(), DriveState::kRun);
  EXPECT_EQ(machine.current_share(), 1);
}

TEST(SafetyMachine, VoltageBeyondTheBusIsOneEventForAsLongAsItLasts) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  in.clamped = true;
  int events = 0;
  for (int k = 0; k < 100; ++k) {
    in.clamped = k % 3 != 0;
    machine.step(in);
    events += machine.event_count();
  }
  EXPECT_EQ(events, 1);
  EXPECT_FALSE(machine.is_off());
}

TEST(SafetyMachine, AFaultyReadingIsAnEventWhenItBegins) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  in.faulty = 2;
  machine.step(in);
  ASSERT_EQ(machine.event_count(), 1);
  EXPECT_EQ(machine.event(0).reason, Reason::kSensorFault);
  machine.step(in);
  EXPECT_EQ(machine.event_count(), 0);
}

TEST(SafetyMachine, AResetNeedsTheCauseToBeGone) {
  SafetyMachine machine = machine_in_run();
  EXPECT_FALSE(machine.reset()) << "not off";
  SafetyInput in = running();
  in.v_dc = 40;
  machine.step(in);
  ASSERT_TRUE(machine.is_off());
  EXPECT_FALSE(machine.reset()) << "the bus is still too high";
  machine.step(running());
  ASSERT_TRUE(machine.reset());
  EXPECT_EQ(machine.state(), DriveState::kIdle);
  ASSERT_EQ(machine.event_count(), 1);
  EXPECT_EQ(machine.event(0).reason, Reason::kReset);
  machine.step(running());
  EXPECT_EQ(machine.state(), DriveState::kRun);
}

// The first row of the table decides where two faults come at once.
TEST(SafetyMachine, OneReasonWhereTwoFaultsComeAtOnce) {
  SafetyMachine machine = machine_in_run();
  SafetyInput in = running();
  in.v_dc = 40;
  in.supervisor_silent = true;
  machine.step(in);
  ASSERT_EQ(machine.event_count(), 1);
  EXPECT_EQ(reason_of_trip(machine), Reason::kOverVoltage);
}

}  // namespace
}  // namespace twinrate::state_machine_test
