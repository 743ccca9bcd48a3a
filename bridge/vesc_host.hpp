// A VESC, listened to: bursts of sampled data, one after the other.
//
//   frame   2 length8 | 3 length16, payload, CRC-16 (0x1021, start 0) of the payload, 3
//   -> GET_VALUES (4)      bus voltage
//   -> SAMPLE_PRINT (19)   mode, count, decimation, raw: a burst of kBurst samples at the control rate
//   <- SAMPLE_PRINT        i_1, i_2, i_3 (A; an older firmware leaves i_3 out), phase voltages at the
//                          terminals and their zero (V), filtered current, control rate (Hz): float32
//                          big-endian; status; electrical angle in 1/250 turns
//
// A burst is whole in itself; the time between two is not known. A burst begins kGap ticks after the
// one before, which the filter sees as a gap. rates.f_s_Hz must be the control rate.
#pragma once
#include <deque>

#include "bridge/host_protocol.hpp"

namespace twinrate {

std::uint16_t vesc_crc(std::span<const std::uint8_t> payload);
Bytes vesc_frame(std::span<const std::uint8_t> payload);

// Payloads out of bytes.
class VescReceiver {
 public:
  static constexpr std::size_t kMaxPayload = 512;
  // Calls `take` for each whole payload.
  template <class Take>
  void receive(std::span<const std::uint8_t> bytes, Take&& take) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
    while (next()) take(std::span<const std::uint8_t>(payload_));
  }
  std::int64_t damaged() const { return damaged_; }

 private:
  bool next();
  Bytes bytes_, payload_;
  std::int64_t damaged_ = 0;
};

class VescHost final : public HostProtocol {
 public:
  static constexpr int kGetValues = 4, kSamplePrint = 19, kBurst = 1000, kGap = 100;
  static constexpr double kAngleSteps = 250;

  VescHost(const BridgeParameters& bridge, const DriveConfig& drive)
      : bridge_(bridge), drive_(drive) {}

  void take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) override;
  std::optional<DriveSample> next() override;
  Bytes hello(bool) override;
  Bytes poll(std::int64_t now_ns) override;
  Time time() const override { return Time::kNone; }
  Bytes command(const DriveCommand&) override { return {}; }
  Bytes off() override { return {}; }
  Bytes clear(int) override { return {}; }

 private:
  void take_payload(std::span<const std::uint8_t> payload, std::int64_t arrival_ns);
  void take_sample(std::span<const std::uint8_t> payload, std::int64_t arrival_ns);

  BridgeParameters bridge_;
  DriveConfig drive_;
  VescReceiver receiver_;
  std::deque<DriveSample> samples_;
  std::int64_t k_ = -1;
  int left_ = 0;               // of the burst
  std::int64_t heard_ns_ = 0;  // the last sample of a burst, or the question for it
  double v_dc_ = 0, theta_e_ = 0, angle_ = -1;
};

}  // namespace twinrate
