// The device's side of the twinrate protocol, around an emulated drive. The firmware of a drive
// uses the same protocol header: firmware/examples/simplefoc.ino.
#pragma once
#include <deque>

#include "emulator/device.hpp"
#include "firmware/protocol/twinrate_protocol.h"

namespace twinrate {

class TwinrateDevice final : public EmulatedDevice {
 public:
  TwinrateDevice(const DeviceOptions& options, EmulatedDrive& drive)
      : options_(options), drive_(drive) {}

  void take(std::span<const std::uint8_t> bytes) override;
  bool waits() const override;
  bool lockstep() const override { return lockstep_; }
  void tick() override;
  void repeat() override;
  std::string account() const override;

  std::int64_t bad_frames() const { return bad_frames_; }
  std::int64_t lost_frames() const { return lost_frames_; }
  // Number of accepted commands that enable the drive.
  std::uint32_t leased_commands() const { return leased_; }
  // Number of leases that expired without a command.
  std::int64_t leases_ended() const { return leases_ended_; }

 private:
  void take_command(const twp_frame& f);
  void send_info(std::uint32_t question);
  void send_sample();
  void send(twp_frame& f);
  void restart();
  void note_outputs();
  const Command* in_force();
  std::uint32_t now_us() const;

  DeviceOptions options_;
  EmulatedDrive& drive_;
  twp_receiver receiver_{};
  twp_lease lease_{};
  std::uint16_t flags_ = TWP_ALL_GROUPS;
  bool lockstep_ = false, was_reset_ = false, has_command_ = false;
  bool knows_host_ = false;                    // command_seq_ is of one of its frames
  std::int64_t first_k_ = 0;                   // of the drive at the last restart
  std::int64_t sampled_ = -1, answered_ = -1;  // ticks of the device
  std::uint32_t command_seq_ = 0, leased_ = 0;
  std::int64_t bad_frames_ = 0, lost_frames_ = 0, leases_ended_ = 0;
  std::int64_t leased_k_ = -1;  // tick of the last enabling command
  std::int64_t off_times_ = 0, off_ticks_most_ = 0;
  bool was_on_ = false;
  std::deque<Command> coming_;  // by k, the tick whose sample they answer
  Command command_;             // in force
  twp_frame last_sample_{};
};

}  // namespace twinrate
