// Host and device in simulated time: the loop over the link, and what each fault does.
#include "emulator/rehearsal.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::rehearsal_test {
namespace {

Config drive(std::vector<std::string> more = {}) {
  more.insert(more.end(), {"plant.kind=bridge", "reference.omega_e_rad_s=200"});
  return load_drive("dilys2021", more);
}

struct Case {
  Config config = drive();
  BridgeParameters bridge;
  std::unique_ptr<Rehearsal> run;
  explicit Case(const RehearsalFaults& faults, unsigned seed = 1,
                std::vector<std::string> more = {})
      : config(drive(std::move(more))), bridge(config.read<BridgeParameters>()) {
    run = std::make_unique<Rehearsal>(config, bridge, faults, seed);
  }
  bool has(Reason reason) const {
    return std::any_of(run->events.begin(), run->events.end(),
                       [&](const GuardEvent& e) { return e.reason == reason; });
  }
};

TEST(Rehearsal, OverACleanLinkTheLoopEqualsTheSimulatedOneBitForBit) {
  Case c({});
  Config plain = load_drive("dilys2021", {"reference.omega_e_rad_s=200"});
  ClosedLoop loop(plain);
  c.run->run_until(0.2);
  while (loop.k() < c.run->drive().plant().k()) loop.step();
  EXPECT_EQ(loop.plant().sample().i_abc, c.run->drive().sample()->i_abc);
  EXPECT_EQ(loop.plant().sample().theta_m, c.run->drive().sample()->theta_m);
  EXPECT_NE(loop.plant().sample().theta_m, 0);
  EXPECT_EQ(c.run->host().counts().disturbed(), 0);
}

// Two ticks: the command comes after the next sample.
TEST(Rehearsal, ALinkOfTwoTicksIsThatOfADelayOfTwo) {
  RehearsalFaults slow;
  slow.up.latency_s = slow.down.latency_s = 120e-6;  // together above a tick of 200 us
  Case c(slow, 1, {"plant.delay_samples=2"});
  Config plain = load_drive("dilys2021", {"reference.omega_e_rad_s=200", "plant.delay_samples=2"});
  ClosedLoop loop(plain);
  c.run->run_until(0.2);
  while (loop.k() < c.run->drive().plant().k()) loop.step();
  EXPECT_EQ(loop.plant().sample().i_abc, c.run->drive().sample()->i_abc);
}

// The drive tells the last command that it has taken: latency shows in ticks, and a late command as one.
TEST(Rehearsal, ALatencyIsFoundInTicksAndLateCommandsAreCounted) {
  const auto counts = [](double each_way_s, std::vector<std::string> more) {
    RehearsalFaults slow;
    slow.up.latency_s = slow.down.latency_s = each_way_s;
    Case c(slow, 1, std::move(more));
    c.run->run_until(0.1);
    return c.run->host().counts();
  };
  const LinkCounts fast = counts(0, {});
  EXPECT_EQ(fast.answer_ticks_most, 1);
  EXPECT_EQ(fast.answer_ticks_mean(), 1);
  EXPECT_EQ(fast.command_late, 0);
  const LinkCounts in_time = counts(120e-6, {"plant.delay_samples=2"});
  EXPECT_EQ(in_time.answer_ticks_most, 2);
  EXPECT_EQ(in_time.command_late, 0);
  const LinkCounts late = counts(120e-6, {});
  EXPECT_EQ(late.answer_ticks_most, 2);
  EXPECT_GT(late.command_late, 450) << "of 500 ticks";
}

TEST(Rehearsal, DamagedLostDoubledFramesAreCountedAndTheLoopGoesOn) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    RehearsalFaults f;
    f.up.bit_errors = 2e-5;
    f.up.lost = f.up.doubled = f.up.reordered = 0.005;
    f.down = f.up;
    Case c(f, seed);
    c.run->run_until(0.3);
    const LinkCounts& counts = c.run->host().counts();
    EXPECT_GT(counts.damaged, 0);
    EXPECT_GT(counts.lost, 0);
    EXPECT_GT(counts.doubled, 0);
    EXPECT_GT(counts.late, 0);
    EXPECT_GT(c.run->device().bad_frames(), 0);
    EXPECT_GT(c.run->device().lost_frames(), 0);
    EXPECT_FALSE(c.run->guard().is_off());
    EXPECT_EQ(c.run->drive().latched(), Reason::kNone);
    EXPECT_GT(c.run->drive().sample()->omega_m, 30) << "it runs: 50 rad/s wanted";
  }
}

// The outputs are off within the lease and a tick, in device time.
void expect_off_in_time(const Case& c, double lease_s = 0.02) {
  const double T_s = c.config.drive().T_s();
  EXPECT_GE(c.run->off_after_s(), 0) << "still on";
  EXPECT_LE(c.run->off_after_s(), lease_s + 2 * T_s);
  EXPECT_EQ(c.run->drive().sample()->u_alphabeta.norm(), 0);
}

TEST(Rehearsal, APulledCableEndsTheLeaseAndIsClearedByHandAlone) {
  RehearsalFaults f;
  f.up.pulled_at_s = f.down.pulled_at_s = 0.1;
  f.up.pulled_for_s = f.down.pulled_for_s = 0.4;
  Case c(f);
  c.run->run_until(0.4);
  expect_off_in_time(c);
  EXPECT_EQ(c.run->drive().latched(), Reason::kCommandLost);
  EXPECT_TRUE(c.has(Reason::kLinkLost));
  c.run->run_until(0.6);
  EXPECT_EQ(c.run->drive().latched(), Reason::kCommandLost) << "the cable is back: still off";
  c.run->restart_host(false);
  c.run->run_until(0.7);
  EXPECT_EQ(c.run->drive().latched(), Reason::kCommandLost) << "a new host does not clear it";
  c.run->restart_host(true);
  c.run->run_until(0.75);
  EXPECT_EQ(c.run->drive().latched(), Reason::kNone);
  EXPECT_GT(c.run->drive().sample()->u_alphabeta.norm(), 0);
}

TEST(Rehearsal, AHostThatDiesEndsTheLease) {
  RehearsalFaults f;
  f.host_ends_at_s = 0.1;
  Case c(f, 1, {"bridge.lease_ms=3"});
  c.run->run_until(0.2);
  expect_off_in_time(c, 0.003);
  EXPECT_EQ(c.run->drive().latched(), Reason::kCommandLost);
}

TEST(Rehearsal, ARestartOfTheDriveSwitchesOff) {
  RehearsalFaults f;
  f.device.reset_at_s = 0.1;
  Case c(f);
  c.run->run_until(0.2);
  EXPECT_TRUE(c.has(Reason::kDeviceReset));
  expect_off_in_time(c);
  EXPECT_EQ(c.run->host().counts().resets, 1);
}

// The drive counts its ticks from 0 again; a log of the samples has each tick once.
TEST(Rehearsal, TheTicksOfSamplesGoOnOverARestartOfTheDrive) {
  RehearsalFaults f;
  f.device.reset_at_s = 0.1;
  Case c(f);
  c.run->run_until(0.2);
  const std::vector<std::int64_t>& ticks = c.run->ticks();
  ASSERT_EQ(c.run->host().counts().resets, 1);
  ASSERT_GT(ticks.size(), 900u);
  for (std::size_t i = 1; i < ticks.size(); ++i) ASSERT_EQ(ticks[i], ticks[i - 1] + 1);
  c.run->restart_host(true);
  c.run->run_until(0.21);
  EXPECT_GT(c.run->drive().sample()->u_alphabeta.norm(), 0);
}

// A host that goes on after a restart names the ticks of the drive in its commands.
TEST(TwinrateHost, CommandsAfterARestartAnswerTheDrivesOwnTicks) {
  const auto sample_of = [](std::uint32_t seq) {
    twp_frame f{};
    f.header = {.type = TWP_SAMPLE, .flags = TWP_CURRENTS, .seq = seq};
    Bytes wire(TWP_MAX_WIRE);
    wire.resize(twp_write(&f, wire.data()));
    return wire;
  };
  TwinrateHost host(false);
  for (const std::uint32_t seq : {500u, 501u, 3u, 4u}) host.take(sample_of(seq), 0);
  std::int64_t k = 0;
  for (const std::int64_t expected : {500, 501, 502, 503}) {
    const auto sample = host.next();
    ASSERT_TRUE(sample);
    EXPECT_EQ(k = sample->m.k, expected);
  }
  twp_receiver receiver{};
  twp_frame f{};
  for (const std::uint8_t byte : host.command({.sample_k = k})) twp_receive(&receiver, byte, &f);
  EXPECT_EQ(f.body.command.sample_seq, 4u);
}

TEST(Rehearsal, ADriveThatKeepsItsLastCommandIsNamed) {
  RehearsalFaults f;
  f.device.keeps_last = true;
  Case c(f);
  c.run->run_until(0.1);
  c.run->emergency_stop();
  c.run->run_until(0.2);
  EXPECT_TRUE(c.has(Reason::kEmergencyStop));
  EXPECT_TRUE(c.has(Reason::kDeviceDisobeys));
  Case obedient({});
  obedient.run->run_until(0.1);
  obedient.run->emergency_stop();
  obedient.run->run_until(0.2);
  EXPECT_FALSE(obedient.has(Reason::kDeviceDisobeys));
  EXPECT_EQ(obedient.run->drive().sample()->u_alphabeta.norm(), 0);
  EXPECT_EQ(obedient.run->drive().latched(), Reason::kNone) << "the host's off latches nothing";
}

TEST(Rehearsal, TheDrivesOwnTripReachesTheHost) {
  Case c({}, 1, {"machine.i_trip_A=0.05"});
  c.run->run_until(0.1);
  EXPECT_EQ(c.run->drive().latched(), Reason::kOverCurrent);
  EXPECT_TRUE(c.has(Reason::kOverCurrent));
  EXPECT_TRUE(c.run->guard().is_off());
}

TEST(Rehearsal, ClockDriftOf100PpmChangesNothingButTheClock) {
  RehearsalFaults f;
  f.drift_ppm = 100;
  Case c(f);
  c.run->run_until(0.5);
  EXPECT_NEAR(c.run->host().clock().drift(), -100e-6, DeviceClock::kDriftBound);
  EXPECT_EQ(c.run->host().counts().disturbed(), 0);
  EXPECT_FALSE(c.run->guard().is_off());
}

// A drive may take duties alone: the same voltage reaches the motor.
TEST(TwinrateHost, SendsDutiesToADriveThatTakesNoVoltageVector) {
  for (const bool takes_voltage : {true, false}) {
    Config config = drive();
    PlantDrive plant(config);
    TwinrateDevice device(
        {.name = "a", .T_s = config.drive().T_s(), .takes_voltage = takes_voltage}, plant);
    TwinrateHost host(true);
    const auto hear = [&] {
      device.tick();
      for (const Bytes& frame : device.take_sent()) host.take(frame, 0);
    };
    device.take(host.hello(false));
    hear();
    ASSERT_TRUE(host.info());
    EXPECT_TRUE(host.info()->takes_duties);
    EXPECT_EQ(host.info()->takes_voltage, takes_voltage);
    std::int64_t k = 0;
    for (int i = 0; i < 4; ++i) {
      while (const auto sample = host.next()) k = sample->m.k;
      Command c;
      c.u_alphabeta_ref = {1.5, -0.75};
      const Bytes wire = host.command({.command = c, .sample_k = k, .lease_us = 20000});
      twp_receiver receiver{};
      twp_frame f{};
      for (const std::uint8_t byte : wire) twp_receive(&receiver, byte, &f);
      EXPECT_EQ(f.body.command.kind, takes_voltage ? TWP_COMMAND_VOLTAGE : TWP_COMMAND_DUTIES);
      device.take(wire);
      hear();
    }
    EXPECT_NEAR(plant.sample()->u_alphabeta[0], 1.5, 1e-3);
    EXPECT_NEAR(plant.sample()->u_alphabeta[1], -0.75, 1e-3);
  }
}

// An earlier host (a probe) let the drive keep its own pace; its samples and answers are still on the
// line when the next host asks for lock-step.
TEST(Lockstep, BeginsWithTheSampleThatTheDriveWaitsWith) {
  Config config = drive();
  PlantDrive plant(config);
  TwinrateDevice device({.name = "a", .T_s = config.drive().T_s()}, plant);
  TwinrateHost probe(true, 1, 7'000'000), host(true, 1, 90);
  Bytes line;
  const auto sent = [&] {
    for (const Bytes& frame : device.take_sent())
      line.insert(line.end(), frame.begin(), frame.end());
  };
  for (int i = 0; i < 5; ++i) {
    device.take(probe.hello(false));
    for (int k = 0; k < 3; ++k) device.tick();
    sent();
  }
  device.take(host.hello(true));
  for (int i = 0; i < 4; ++i) device.tick();
  EXPECT_TRUE(device.waits());
  sent();
  host.take(line, 0);
  ASSERT_TRUE(host.info());
  const auto first = host.next();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->m.k, device.k());
  EXPECT_FALSE(host.next());
  EXPECT_EQ(host.counts().disturbed(), 0);
}

TEST(Line, AFrameThatDoesNotFitIntoTheBufferOfASlowLineIsLost) {
  FaultyLine line({.baud = 1'000'000}, 1);
  const Bytes frame(100, 0x55);  // 1 ms of wire time
  for (int i = 0; i < 100; ++i) line.send(frame, 0);
  EXPECT_EQ(line.receive(40'000'000).size(), 4000u);
  EXPECT_EQ(line.receive(1'000'000'000).size(), 0u);
  line.send(frame, 1'000'000'000);
  EXPECT_EQ(line.receive(1'001'000'000).size(), 100u);
}

TEST(Line, ASenderThatWaitsForRoomLosesNothing) {
  FaultyLine line({.baud = 1'000'000, .waits = true}, 1);
  const Bytes frame(100, 0x55);  // 1 ms of wire time
  for (int i = 0; i < 100; ++i) line.send(frame, 0);
  EXPECT_EQ(line.receive(40'000'000).size(), 4000u);
  EXPECT_EQ(line.receive(100'000'000).size(), 6000u);
}

}  // namespace
}  // namespace twinrate::rehearsal_test
