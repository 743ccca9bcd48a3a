// A moteus behind an fdcanusb, around an emulated drive: the documented lines and registers, its
// own current control, and its timeout, which acts in modes 10 and 13 only. It also sends the burst
// of its debug UART (servo.emit_debug = 13). The registers: bridge/moteus_codec.hpp.
//
// A register has the value of the previous control tick. For that moment the voltage is known, too:
// it is the mean of the periods before and after it.
#pragma once
#include <optional>
#include <string>

#include "emulator/device.hpp"

namespace twinrate {

class MoteusDevice final : public EmulatedDevice {
 public:
  MoteusDevice(const DeviceOptions& options, EmulatedDrive& drive, const MachineParameters& machine)
      : options_(options), drive_(drive), machine_(machine) {}

  void take(std::span<const std::uint8_t> bytes) override;
  void tick() override;
  int mode() const { return mode_; }

 private:
  void take_line(const std::string& line);
  void write(int reg, double value);
  double read(int reg) const;
  const Measurement* at_last_tick() const;
  void enter(int mode);
  // Computes the voltage of the mode at this tick; false: the outputs are off.
  bool control(Command& command);
  Vec2 current_control(const Vec2& i_dq, double i_q_ref, double omega_e);

  DeviceOptions options_;
  EmulatedDrive& drive_;
  MachineParameters machine_;
  std::string line_;
  int mode_ = 0;
  double torque_ = 0, kp_scale_ = 1, kd_scale_ = 1, timeout_s_ = 0.1, heard_s_ = 0;
  std::optional<Measurement> last_tick_;
  Vec2 u_dq_ = Vec2::Zero(), integral_ = Vec2::Zero();
};

class MoteusBurstDevice final : public EmulatedDevice {
 public:
  MoteusBurstDevice(EmulatedDrive& drive, const MachineParameters& machine)
      : drive_(drive), machine_(machine) {}
  bool speaks_first() const override { return true; }
  void take(std::span<const std::uint8_t>) override {}
  void tick() override;

 private:
  EmulatedDrive& drive_;
  MachineParameters machine_;
};

}  // namespace twinrate
