// The common interface to drives of any protocol: bytes in, samples out; commands in, bytes out. No
// I/O and no clock: the caller provides bytes with their time of arrival.
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bridge/device_clock.hpp"
#include "core/bridge_parameters.hpp"
#include "core/drive_config.hpp"

namespace twinrate {

using Bytes = std::vector<std::uint8_t>;

// One control tick of the drive.
struct DriveSample {
  Measurement m;             // k: tick of the drive; t_ns is not set
  std::int64_t time_us = 0;  // device time without wraps
  std::int64_t arrival_ns = 0;
  std::optional<double> sampled_us;  // device time, if known better than by the tick
  std::int64_t command_seq = 0;      // of the last command that the drive took; 0: none, or unknown
  int reason = 0;                    // code of core/reason.hpp while the drive is off by itself
  bool off = false;                  // latched
};

struct DriveCommand {
  Command command;
  std::int64_t sample_k = 0;  // that it answers
  std::uint32_t lease_us = 0;
};

struct DriveInfo {
  std::string name;
  double f_s_Hz = 0;  // 0: unknown
  double lease_max_ms = 0;
  bool lockstep = false, watchdog = false, takes_voltage = false, takes_duties = false;
  bool float64 = false;
  int reason = 0;                                // latched
  std::int64_t bad_frames = 0, lost_frames = 0;  // of the host's, as the drive counts them
};

struct LinkCounts {
  std::int64_t frames = 0;   // whole ones
  std::int64_t damaged = 0;  // CRC, framing, version
  std::int64_t lost = 0;     // missing in the sequence
  std::int64_t doubled = 0, late = 0;
  std::int64_t resets = 0;  // of the drive
  // Polled samples: the number of those with a round trip that gives their moment, and the largest
  // deviation of the moment from its middle, from the excess over the shortest round trip; samples
  // with a longer round trip are left out.
  std::int64_t timed = 0, untimed = 0;
  double within_us = 0, within_us_most = 0;  // sum, largest
  // Samples that show the command that their tick was due for not taken yet: it acts late. And the age
  // of the last command taken, over all samples, in ticks: 1 on a fast link.
  std::int64_t command_late = 0;
  std::int64_t answered = 0, answer_ticks = 0, answer_ticks_most = 0;
  double answer_ticks_mean() const {
    return answered == 0 ? 0 : static_cast<double>(answer_ticks) / static_cast<double>(answered);
  }
  double within_us_mean() const { return timed == 0 ? 0 : within_us / static_cast<double>(timed); }
  std::int64_t disturbed() const { return damaged + lost + doubled + late; }
};

class HostProtocol {
 public:
  virtual ~HostProtocol() = default;
  virtual void take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) = 0;
  // The next sample in order; a late or doubled one is counted and dropped.
  virtual std::optional<DriveSample> next() = 0;
  // A request for DriveInfo; `lockstep`: the drive must wait for the command of each tick. Empty if
  // the drive takes no request.
  virtual Bytes hello(bool lockstep) = 0;
  // A request for a sample, if the drive does not send by itself; else empty.
  virtual Bytes poll(std::int64_t /*now_ns*/) { return {}; }
  // A question has left.
  virtual void asked(std::int64_t /*now_ns*/) {}
  virtual Bytes command(const DriveCommand& command) = 0;
  // Outputs off; the last frame of a host that ends.
  virtual Bytes off() = 0;
  // By hand alone: leaves the latched state of this reason.
  virtual Bytes clear(int reason) = 0;

  const std::optional<DriveInfo>& info() const { return info_; }
  // From here on only an answer to a later question counts.
  virtual void forget_info() { info_.reset(); }
  const LinkCounts& counts() const { return counts_; }
  const DeviceClock& clock() const { return clock_; }
  // The drive's time, by its frames.
  enum class Time { kMicroseconds, kMilliseconds, kNone };
  virtual Time time() const { return Time::kMicroseconds; }

 protected:
  std::optional<DriveInfo> info_;
  LinkCounts counts_;
  DeviceClock clock_;
};

std::unique_ptr<HostProtocol> make_protocol(const BridgeParameters& bridge,
                                            const DriveConfig& drive);

}  // namespace twinrate
