// A moteus on an fdcanusb, and the burst of its debug UART.
//
// Listening polls i_d, i_q, position, speed, bus and phase voltages, and the millisecond counter; the
// phase currents are i_d, i_q turned by n_p position + bridge.theta_e_offset_rad. The tick is that of
// the millisecond counter: rates.f_s_Hz is 1000 at most. The phase voltages are those of the moment;
// the mean over a tick is made from the moments at both of its ends, in rotor axes.
//
// Control sends the torque 3/2 n_p psi_f i_q* in position mode with both gains scaled to 0, where the
// watchdog acts, or (bridge.without_watchdog) u_d, u_q in mode 8, where there is none.
//
// The debug UART (servo.emit_debug = 13) sends 0x5a and three 16-bit words each control period:
// encoder / 2^16 turns, i_d and i_q in 100/32767 A. No time and no checksum: a frame counts where the
// next one begins with 0x5a too, and a lost frame is not seen.
#pragma once
#include <deque>

#include "bridge/host_protocol.hpp"
#include "bridge/moteus_codec.hpp"

namespace twinrate {

class MoteusHost final : public HostProtocol {
 public:
  static constexpr std::size_t kMaxLine = 512;

  MoteusHost(const BridgeParameters& bridge, const DriveConfig& drive)
      : bridge_(bridge), drive_(drive) {}

  void take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) override;
  std::optional<DriveSample> next() override;
  Bytes hello(bool lockstep) override;
  Bytes poll() override;
  Bytes command(const DriveCommand& command) override;
  Bytes off() override;
  Bytes clear(int reason) override;

 private:
  void take_line(const std::string& line, std::int64_t arrival_ns);
  void take_reply(const MoteusFrame& frame, std::int64_t arrival_ns);
  Bytes sent(Bytes frame) const;
  void put_query(Bytes& frame) const;
  Vec2 mean_voltage_up_to(std::int64_t k, const Vec2& u_dq);

  BridgeParameters bridge_;
  DriveConfig drive_;
  std::string line_;
  std::deque<DriveSample> samples_;
  std::int64_t k_ = -1, device_us_ = 0;
  double theta_e_ = 0, theta_e_before_ = 0;
  Vec2 u_dq_before_ = Vec2::Zero();
  bool asked_ = false;
  int quiet_polls_ = 0;
};

class MoteusBurst final : public HostProtocol {
 public:
  static constexpr std::size_t kFrame = 7;
  MoteusBurst(const BridgeParameters& bridge, const DriveConfig& drive)
      : bridge_(bridge), drive_(drive) {}

  void take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) override;
  std::optional<DriveSample> next() override;
  Bytes hello(bool) override;  // the drive sends by itself
  Bytes command(const DriveCommand&) override { return {}; }
  Bytes off() override { return {}; }
  Bytes clear(int) override { return {}; }

 private:
  void take_frame(const std::uint8_t* frame, std::int64_t arrival_ns);

  BridgeParameters bridge_;
  DriveConfig drive_;
  Bytes bytes_;
  std::deque<DriveSample> samples_;
  std::int64_t k_ = -1;
  double turns_ = 0, raw_ = -1;
};

}  // namespace twinrate
