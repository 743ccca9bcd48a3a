// The rig behind the bridge, against an emulated drive on a UDP line of this machine.
#include "identify/bridge_rig.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <thread>

#include "core/free_udp_port.hpp"
#include "emulator/twinrate_device.hpp"
#include "identify/experiment.hpp"
#include "identify/simulated_rig.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::test {
namespace {

struct LostSamples {
  std::int64_t from = -1, count = 0;
};

// Hears a host and answers, in a thread; its time begins with the first frame. Where the host does not
// ask for lock-step it ticks once a millisecond, or with each frame.
class DeviceOnALine {
 public:
  DeviceOnALine(Config& config, const LostSamples& lost = {})
      : port_(fmt::format("127.0.0.1:{}", free_udp_port())),
        link_(listen_udp(port_)),
        drive_(config),
        device_({.name = "test", .T_s = config.drive().T_s()}, drive_),
        lost_(lost),
        thread_([this] { run(); }) {}
  ~DeviceOnALine() {
    ends_ = true;
    thread_.join();
  }
  std::string port() const { return "udp://" + port_; }
  void fall_silent() { silent_ = true; }
  // The outputs after the last frames of a host.
  double voltage_at_the_end() {
    ends_ = true;
    if (thread_.joinable()) thread_.join();
    thread_ = std::thread([] {});
    for (int k = 0; k < 5; ++k) drive_.advance(nullptr);
    return drive_.sample()->u_alphabeta.norm();
  }

 private:
  void run() {
    while (!ends_) {
      const auto bytes = link_->receive(1);
      if (bytes.empty() && !heard_) continue;
      heard_ = true;
      if (!bytes.empty()) device_.take(bytes);
      device_.tick();
      if (device_.lockstep() && !device_.waits()) device_.tick();
      for (const auto& frame : device_.take_sent()) {
        const bool lost =
            lost_.from >= 0 && device_.k() >= lost_.from && device_.k() < lost_.from + lost_.count;
        if (!silent_ && !lost) link_->send(frame);
      }
    }
  }

  std::string port_;
  std::unique_ptr<Link> link_;
  PlantDrive drive_;
  TwinrateDevice device_;
  LostSamples lost_;
  bool heard_ = false;
  std::atomic<bool> ends_ = false, silent_ = false;
  std::thread thread_;
};

Config drive(const std::string& port, std::vector<std::string> more = {}) {
  more.insert(more.end(),
              {"sensors.encoder_counts=8192", "load.T_load_Nm=0.0", "start=aligned",
               "plant.kind=bridge", "bridge.port=\"" + port + "\"", "bridge.silence_ms=100"});
  return load_drive("dilys2021", more);
}

Vec2 voltage(int k) {
  return {0.3 * std::sin(0.05 * k), 0.2 * std::cos(0.031 * k)};
}

TEST(BridgeRig, InLockStepItsRowsAreThoseOfTheSimulatedRigBitForBit) {
  Config emulated = drive("udp://127.0.0.1:1");
  DeviceOnALine device(emulated);
  Config host = drive(device.port());
  BridgeRig rig(host, RigPace::kAuto);
  EXPECT_NE(rig.where().find("lock-step"), std::string::npos);
  SimulatedRig simulated(emulated, {});
  for (int k = 0; k < 1000; ++k) {
    if (k == 500) rig.pause();
    const RigRow a = rig.step(voltage(k), 0), b = simulated.step(voltage(k), 0);
    ASSERT_EQ(a.i_abc, b.i_abc) << k;
    ASSERT_EQ(a.u_alphabeta, b.u_alphabeta) << k;
    ASSERT_EQ(a.theta_m, b.theta_m) << k;
  }
  EXPECT_TRUE(rig.notes().empty());
  EXPECT_EQ(rig.late_ticks(), 0);
}

TEST(BridgeRig, ASilentDriveEndsTheExperimentsAndItsOutputsAreOff) {
  Config emulated = drive("udp://127.0.0.1:1");
  DeviceOnALine device(emulated);
  {
    Config host = drive(device.port());
    BridgeRig rig(host, RigPace::kAuto);
    for (int k = 0; k < 50; ++k) rig.step(Vec2(1, 0), 0);
    device.fall_silent();
    try {
      for (int k = 0; k < 50; ++k) rig.step(Vec2(1, 0), 0);
      FAIL() << "went on without the drive";
    } catch (const RunFailed& failed) {
      EXPECT_NE(std::string(failed.what()).find("bridge.silence_ms"), std::string::npos)
          << failed.what();
    }
  }
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(device.voltage_at_the_end(), 0);
}

TEST(BridgeRig, MissingSamplesAreToldAndManyInARowEndIt) {
  for (const std::int64_t loses : {3, 40}) {
    Config emulated = drive("udp://127.0.0.1:1");
    DeviceOnALine device(emulated, {.from = 1500, .count = loses});
    Config host = drive(device.port());
    BridgeRig rig(host, RigPace::kRealtime);
    std::string ended;
    try {
      for (int k = 0; k < 3000; ++k) rig.step(Vec2::Zero(), 0);
    } catch (const RunFailed& failed) {
      ended = failed.what();
    }
    if (loses == 3) {
      EXPECT_EQ(ended, "");
      EXPECT_EQ(rig.missing(), 3);
      ASSERT_FALSE(rig.notes().empty());
      EXPECT_NE(rig.notes().front().find("3 of"), std::string::npos) << rig.notes().front();
    } else {
      EXPECT_NE(ended.find("40 samples in a row did not come"), std::string::npos) << ended;
    }
  }
}

TEST(BridgeRig, WhatIsMissingIsNamedBeforeAnythingMoves) {
  Config no_port = load_drive("dilys2021", {"plant.kind=bridge"});
  EXPECT_THROW(BridgeRig(no_port, RigPace::kAuto), BadInput);
  Config moteus =
      load_drive("dilys2021", {"plant.kind=bridge", "bridge.protocol=moteus", "rates.f_s_Hz=1000",
                               "bridge.port=\"udp://127.0.0.1:1\""});
  EXPECT_THROW(BridgeRig(moteus, RigPace::kAuto), BadInput);
  Config emulated = drive("udp://127.0.0.1:1", {"inverter.v_dc_V=12"});
  DeviceOnALine device(emulated);
  Config host = drive(device.port());
  try {
    BridgeRig rig(host, RigPace::kAuto);
    FAIL() << "took 12 V for 24 V";
  } catch (const BadInput& bad) {
    EXPECT_NE(std::string(bad.what()).find("the drive reads 12 V, found 24"), std::string::npos)
        << bad.what();
  }
}

}  // namespace
}  // namespace twinrate::test
