// A simulated drive with a device protocol, tick by tick, without I/O and clock.
//
//   take(bytes)   bytes have arrived from the host
//   tick()        at t_k: sends the sample of t_k, chooses the command in force, and advances the
//                 drive to t_{k+1}
//
// In lock-step (on the host's request) tick() waits for the command that answers the last sample.
#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "core/bridge_parameters.hpp"
#include "core/drive_config.hpp"
#include "emulator/drive.hpp"

namespace twinrate {

struct DeviceFaults {
  bool keeps_last = false;  // ignores lease and off: a drive that keeps its last command
  double reset_at_s = 1e9;  // restarts once
};

struct DeviceOptions {
  std::string name;
  DriveProtocol protocol = DriveProtocol::kTwinrate;
  double T_s = 0, lease_max_s = 0.02;
  int delay = 1, moteus_id = 1;
  MoteusListen moteus_listen = MoteusListen::kPoll;
  bool takes_voltage = true;  // else only duties
  DeviceFaults faults;
};

class EmulatedDevice {
 public:
  using Bytes = std::vector<std::uint8_t>;
  virtual ~EmulatedDevice() = default;
  virtual void take(std::span<const std::uint8_t> bytes) = 0;
  // The bytes sent since the last call, one entry a frame.
  std::vector<Bytes> take_sent() { return std::exchange(sent_, {}); }
  // Lock-step: the command that answers the last sample has not arrived.
  virtual bool waits() const { return false; }
  // True if the drive sends without a request of the host.
  virtual bool speaks_first() const { return false; }
  virtual bool lockstep() const { return false; }
  virtual void tick() = 0;
  // Lock-step, if no command arrives: sends the last sample again.
  virtual void repeat() {}
  // One line about the host's frames, for the end of the run.
  virtual std::string account() const { return {}; }
  std::int64_t k() const { return k_; }

 protected:
  std::vector<Bytes> sent_;
  std::int64_t k_ = 0;  // ticks done
};

// `drive` must outlive the device.
std::unique_ptr<EmulatedDevice> make_device(const DeviceOptions& options, EmulatedDrive& drive,
                                            const DriveConfig& config);

}  // namespace twinrate
