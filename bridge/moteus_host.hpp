// A moteus on an fdcanusb, and the burst of its debug UART.
//
// Listening polls i_d, i_q, position, speed, bus and phase voltages, and the millisecond counter; the
// phase currents are i_d, i_q turned by n_p position + bridge.theta_e_offset_rad. The phase voltages
// are those of the moment; the mean over a tick is made from the moments at both of its ends, in rotor
// axes.
//
// The counter does not show when within its millisecond a register was read. In mode listen the
// host asks once a tick, and the moment of a sample is the middle of its round trip, in the time of
// the drive: host time, unless the counter shows that the drive is emulated at another pace. A
// sample is left out if its round trip exceeds the shortest recent one by 2 kLoose of a tick and by
// kTail times the mean. The first kTimedFrom blocks of the clock give the pace and no sample. In
// mode run the tick is that of the counter: rates.f_s_Hz is 1000 at most.
//
// Control sends the torque 3/2 n_p psi_f i_q* in position mode with both gains scaled to 0, where
// the watchdog acts, or (bridge.without_watchdog) u_d, u_q in mode 8, which has no watchdog.
//
// The debug UART (servo.emit_debug = 13) sends 0x5a and three 16-bit words each control period:
// encoder / 2^16 turns, i_d and i_q in 100/32767 A. No time and no checksum: a frame counts if the
// next one begins with 0x5a, too. A lost frame is not detected.
#pragma once
#include <deque>

#include "bridge/host_protocol.hpp"
#include "bridge/moteus_codec.hpp"
#include "bridge/round_trips.hpp"

namespace twinrate {

class MoteusHost final : public HostProtocol {
 public:
  static constexpr std::size_t kMaxLine = 512;
  static constexpr double kLoose = 0.03, kTail = 4;
  static constexpr std::size_t kTimedFrom = 4;

  MoteusHost(const BridgeParameters& bridge, const DriveConfig& drive)
      : bridge_(bridge), drive_(drive) {}

  void take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) override;
  std::optional<DriveSample> next() override;
  Bytes hello(bool lockstep) override;
  Bytes poll(std::int64_t now_ns) override;
  Time time() const override { return Time::kMilliseconds; }
  void asked(std::int64_t now_ns) override { trips_.asked(now_ns); }
  Bytes command(const DriveCommand& command) override;
  Bytes off() override;
  Bytes clear(int reason) override;

 private:
  void take_line(const std::string& line, std::int64_t arrival_ns);
  void take_reply(const MoteusFrame& frame, std::int64_t arrival_ns);
  DriveInfo info_in(int mode) const;
  void take_values(const MoteusFrame& frame, Measurement& m);
  bool times_samples() const { return bridge_.mode == BridgeMode::kListen; }
  // False if the moment is unknown.
  bool time_sample(DriveSample& sample, const std::optional<RoundTrips::Moment>& trip);
  double host_per_drive() const;
  std::int64_t counted_us(std::uint32_t us, std::int64_t read_ns);
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
  RoundTrips trips_;
  std::int64_t next_poll_ns_ = 0, last_read_ns_ = 0;
  double sampled_us_ = 0;
  std::int64_t last_us_ = 0, k_before_restart_ = 0;  // of the counter
};

class MoteusBurst final : public HostProtocol {
 public:
  static constexpr std::size_t kFrame = 7;
  MoteusBurst(const BridgeParameters& bridge, const DriveConfig& drive)
      : bridge_(bridge), drive_(drive) {}

  void take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) override;
  std::optional<DriveSample> next() override;
  Bytes hello(bool) override;  // the drive sends by itself
  Time time() const override { return Time::kNone; }
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
