// A VESC that runs its own control: GET_VALUES, and bursts of sampled data. The frames:
// bridge/vesc_host.hpp. It takes no commands from a host.
#pragma once
#include <deque>

#include "bridge/vesc_host.hpp"
#include "emulator/device.hpp"

namespace twinrate {

class VescDevice final : public EmulatedDevice {
 public:
  VescDevice(const DeviceOptions& options, EmulatedDrive& drive, const MachineParameters& machine)
      : options_(options), drive_(drive), machine_(machine) {}
  void take(std::span<const std::uint8_t> bytes) override;
  void tick() override;

 private:
  void take_payload(std::span<const std::uint8_t> payload);
  Bytes sample_payload(const Measurement& m) const;

  DeviceOptions options_;
  EmulatedDrive& drive_;
  MachineParameters machine_;
  VescReceiver receiver_;
  int wanted_ = 0;            // samples of the burst that are not taken yet
  std::vector<Bytes> burst_;  // stored until it is complete, as in the drive
};

}  // namespace twinrate
