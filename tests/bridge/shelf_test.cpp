// moteus and VESC: the documented bytes, and host and emulated device against each other.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "bridge/moteus_host.hpp"
#include "bridge/vesc_host.hpp"
#include "emulator/moteus_device.hpp"
#include "emulator/vesc_device.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::shelf_test {
namespace {

Config drive(std::vector<std::string> more = {}) {
  more.insert(more.end(), {"plant.kind=bridge", "bridge.protocol=moteus"});
  return load_drive("dilys2021", more);
}

std::string text(const Bytes& bytes) {
  return {bytes.begin(), bytes.end()};
}

// The frames that both sides have for each other, and one tick of the drive.
void exchange(HostProtocol& host, EmulatedDevice& device, const Bytes& to_device,
              std::int64_t t_ns) {
  device.take(to_device);
  for (const Bytes& frame : device.take_sent()) host.take(frame, t_ns);
}

TEST(Moteus, ReadsTheRegistersOfTheManualsExample) {
  // Reply of docs/reference.md's kind: int8 mode 10, int16 position and speed.
  const Bytes reply = {0x21, 0x00, 0x0a, 0x26, 0x01, 0x10, 0x27, 0x00, 0x01, 0x50, 0x50};
  const MoteusFrame frame = parse_moteus(reply);
  EXPECT_FALSE(frame.bad);
  EXPECT_EQ(frame.replies.at(kMoteusMode), 10);
  EXPECT_EQ(frame.replies.at(kMoteusPosition), 10000);
  EXPECT_EQ(frame.replies.at(kMoteusVelocity), 256);
}

TEST(Moteus, LinesWithUnknownFlagsAreReadAndOthersAreNot) {
  EXPECT_EQ(parse_can_line("rcv 100 21000a E B f x99", "rcv")->bytes.size(), 3u);
  EXPECT_EQ(parse_can_line("rcv 100 21000a", "rcv")->id, 0x100);
  for (const char* bad : {"rcv", "rcv 100", "rcv 100 2", "rcv zz 2100", "rcv 100 21zz", "OK"})
    EXPECT_FALSE(parse_can_line(bad, "rcv")) << bad;
  EXPECT_TRUE(parse_moteus(Bytes{0x2c}).bad);
  EXPECT_TRUE(parse_moteus(Bytes{0x2d, 0x00, 1, 2}).bad) << "cut short";
  EXPECT_TRUE(parse_moteus(Bytes{0x70}).bad);
}

struct Pair {
  Config config;
  BridgeParameters bridge;
  PlantDrive plant;
  MoteusDevice device;
  MoteusHost host;
  explicit Pair(std::vector<std::string> more = {})
      : config(drive(std::move(more))),
        bridge(config.read<BridgeParameters>()),
        plant(config),
        device({.T_s = config.drive().T_s(), .moteus_id = bridge.moteus_id}, plant,
               config.drive().machine),
        host(bridge, config.drive()) {}
  Bytes command(double i_q, double lease_ms = 20) {
    DriveCommand c;
    c.command.i_dq_ref = {0, i_q};
    c.command.u_alphabeta_ref = {1, 0};
    c.lease_us = static_cast<std::uint32_t>(1e3 * lease_ms);
    return host.command(c);
  }
  void tick(int n) {
    for (int i = 0; i < n; ++i) device.tick();
  }
};

TEST(Moteus, TheQuestionIsALineOfTheFdcanusb) {
  Pair p;
  const std::string line = text(p.host.hello(false));
  EXPECT_EQ(line.find("can send 8001 1c0600"), 0u) << line;
  EXPECT_EQ(line.back(), '\n');
}

TEST(Moteus, TorqueThroughPositionModeTurnsTheRotorAndIsReadBack) {
  Pair p;
  for (int i = 0; i < 100; ++i) {
    exchange(p.host, p.device, p.command(0.5), i * 1'000'000);
    p.tick(5);
  }
  EXPECT_EQ(p.device.mode(), kMoteusModePosition);
  std::optional<DriveSample> last;
  while (auto sample = p.host.next()) last = sample;
  ASSERT_TRUE(last);
  const Vec2 i_dq = park(clarke(last->m.i_abc), p.config.drive().machine.n_p * last->m.theta_m);
  EXPECT_NEAR(i_dq[1], 0.5, 0.1);
  EXPECT_GT(last->m.omega_m, 20);
  EXPECT_NEAR(last->m.v_dc, 24, 0.1);
  EXPECT_EQ(p.host.counts().damaged, 0);
}

TEST(Moteus, TheTimeoutActsInPositionModeAlone) {
  Pair torque;
  exchange(torque.host, torque.device, torque.command(0.5), 0);
  torque.tick(50);
  EXPECT_EQ(torque.device.mode(), kMoteusModePosition);
  torque.tick(150);  // 40 ms without a frame, the lease is 20 ms
  EXPECT_EQ(torque.device.mode(), kMoteusModeTimeout);
  EXPECT_EQ(torque.plant.sample()->u_alphabeta.norm(), 0);
  exchange(torque.host, torque.device, torque.command(0.5), 0);
  EXPECT_EQ(torque.device.mode(), kMoteusModeTimeout) << "left through mode stopped alone";
  exchange(torque.host, torque.device, torque.host.clear(0), 0);
  EXPECT_EQ(torque.device.mode(), kMoteusStopped);

  Pair voltage({"bridge.moteus_control=voltage", "bridge.without_watchdog=true"});
  exchange(voltage.host, voltage.device, voltage.command(0), 0);
  voltage.tick(5000);  // a second
  EXPECT_EQ(voltage.device.mode(), kMoteusModeVoltageDq);
  EXPECT_NEAR(voltage.plant.sample()->u_alphabeta.norm(), 1, 1e-6) << "it keeps its last command";
  exchange(voltage.host, voltage.device, voltage.host.off(), 0);
  voltage.tick(2);
  EXPECT_EQ(voltage.plant.sample()->u_alphabeta.norm(), 0);
}

TEST(Moteus, TheBurstIsReadInStepAndAfterNoise) {
  Config config = drive();
  OwnControlDrive own(config);
  MoteusBurstDevice device(own, config.drive().machine);
  MoteusBurst host(config.read<BridgeParameters>(), config.drive());
  host.take(Bytes{1, 2, 0x5a, 4}, 0);
  for (int i = 0; i < 3000; ++i) {
    const Measurement m = *own.sample();
    device.tick();
    for (const Bytes& frame : device.take_sent()) host.take(frame, i * 200'000);
    if (const auto sample = host.next(); sample && i > 2000) {
      EXPECT_NEAR(sample->m.i_abc[0], m.i_abc[0], 0.3) << "one tick apart, and 3 mA of rounding";
    }
  }
  EXPECT_GT(host.counts().frames, 2990);
  EXPECT_LE(host.counts().damaged, 2);
}

// theta_e = n_p theta of the drive + bridge.theta_e_offset_rad: of two hosts that hear the same.
TEST(AngleZero, OfTheDriveIsAddedByEveryProtocol) {
  const std::string turned = "bridge.theta_e_offset_rad=0.4";
  const auto expect_ahead = [](HostProtocol& plain, HostProtocol& ahead, int n_p,
                               const char* protocol) {
    const auto a = plain.next(), b = ahead.next();
    ASSERT_TRUE(a && b) << protocol;
    EXPECT_NEAR(n_p * (b->m.theta_m - a->m.theta_m), 0.4, 1e-9) << protocol;
  };
  Pair polled, polled_turned({turned});
  for (Pair* p : {&polled, &polled_turned}) exchange(p->host, p->device, p->host.hello(false), 0);
  expect_ahead(polled.host, polled_turned.host, polled.config.drive().machine.n_p, "moteus, poll");

  Config config = drive(), other = drive({turned});
  OwnControlDrive own(config);
  const DriveConfig& d = config.drive();
  MoteusBurstDevice burst(own, d.machine);
  MoteusBurst uart(config.read<BridgeParameters>(), d),
      uart_turned(other.read<BridgeParameters>(), d);
  VescDevice vesc_device({.T_s = d.T_s()}, own, d.machine);
  VescHost vesc(config.read<BridgeParameters>(), d), vesc_turned(other.read<BridgeParameters>(), d);
  vesc_device.take(vesc.hello(false));
  for (int i = 0; i < 2000; ++i) {
    burst.tick();
    for (const Bytes& frame : burst.take_sent())
      for (HostProtocol* host :
           {static_cast<HostProtocol*>(&uart), static_cast<HostProtocol*>(&uart_turned)})
        host->take(frame, i * 200'000);
    vesc_device.take(vesc.poll(i * 200'000));
    vesc_turned.poll(i * 200'000);
    vesc_device.tick();
    for (const Bytes& frame : vesc_device.take_sent())
      for (HostProtocol* host :
           {static_cast<HostProtocol*>(&vesc), static_cast<HostProtocol*>(&vesc_turned)})
        host->take(frame, i * 200'000);
  }
  expect_ahead(uart, uart_turned, d.machine.n_p, "moteus, uart");
  expect_ahead(vesc, vesc_turned, d.machine.n_p, "vesc");
}

TEST(Vesc, FramesHaveTheDocumentedCrc) {
  // GET_VALUES as every VESC tool sends it.
  EXPECT_EQ(vesc_frame(Bytes{4}), (Bytes{2, 1, 4, 0x40, 0x84, 3}));
  Bytes big(300, 7);
  EXPECT_EQ(vesc_frame(big)[0], 3);
  VescReceiver receiver;
  Bytes stream = {9, 2, 3};
  for (const Bytes& frame : {vesc_frame(big), vesc_frame(Bytes{4})})
    stream.insert(stream.end(), frame.begin(), frame.end());
  std::vector<std::size_t> sizes;
  receiver.receive(stream, [&](auto payload) { sizes.push_back(payload.size()); });
  EXPECT_EQ(sizes, (std::vector<std::size_t>{300, 1}));
}

TEST(Vesc, BurstsReachTheLogWithVoltagesAndAngle) {
  Config config = load_drive("dilys2021", {"plant.kind=bridge", "bridge.protocol=vesc",
                                           "bridge.mode=listen", "run.duration_s=5"});
  const DriveConfig& d = config.drive();
  OwnControlDrive own(config);
  VescDevice device({.T_s = d.T_s()}, own, d.machine);
  VescHost host(config.read<BridgeParameters>(), d);
  exchange(host, device, host.hello(false), 0);
  ASSERT_TRUE(host.info());
  std::vector<Measurement> sent;
  for (int i = 0; i < 4000; ++i) {
    device.take(host.poll(i * 200'000));
    sent.push_back(*own.sample());
    device.tick();
    for (const Bytes& frame : device.take_sent()) host.take(frame, i * 200'000);
  }
  std::vector<DriveSample> got;
  while (auto sample = host.next()) got.push_back(*sample);
  ASSERT_GE(got.size(), 3u * VescHost::kBurst);
  EXPECT_EQ(got[VescHost::kBurst].m.k - got[VescHost::kBurst - 1].m.k, VescHost::kGap + 1);
  for (std::size_t i = 0; i < VescHost::kBurst; i += 50) {
    EXPECT_NEAR(got[i].m.i_abc[1], sent[i].i_abc[1], 1e-6);
    EXPECT_NEAR(got[i].m.u_alphabeta[1], sent[i].u_alphabeta[1], 1e-5);
    EXPECT_NEAR(std::remainder(d.machine.n_p * (got[i].m.theta_m - sent[i].theta_m), kTwoPi), 0,
                kTwoPi / 250 + 1e-9);
    EXPECT_EQ(got[i].m.v_dc, 24);
  }
}

}  // namespace
}  // namespace twinrate::shelf_test
