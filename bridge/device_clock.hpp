// Device time against host time, from the arrival of frames.
//
//   t_host = offset + (1 + drift) t_device + delay          delay >= least delay of the link
//
// A frame can come late, never early. Each block of kBlock_us of device time keeps the frame with
// the least t_host - t_device; the line below the last kBlocks of these points that touches them
// (the edge of their lower convex hull over the middle) is the estimate. Its offset holds the least
// delay of the link, which no one-way measurement can separate.
//
// Bound (tests/bridge): with frames at 1 kHz or faster, a drift of 100 ppm and a jitter of 1 ms,
// from kBlocks blocks on, the line is within kOffsetBound_us of the earliest possible arrival and
// the drift within kDriftBound.
#pragma once
#include <cstdint>
#include <deque>

namespace twinrate {

class DeviceClock {
 public:
  static constexpr std::int64_t kBlock_us = 50'000;
  static constexpr std::size_t kBlocks = 64;  // 3.2 s
  static constexpr double kOffsetBound_us = 50, kDriftBound = 20e-6;

  // One frame: device time modulo 2^32 us, host time of its arrival. Returns the device time
  // without wraps, us since the first frame's.
  std::int64_t take(std::uint32_t time_us, std::int64_t arrival_ns);
  // The device has restarted.
  void restart() { *this = {}; }

  bool known() const { return points_.size() >= 2; }
  bool settled() const { return points_.size() >= kBlocks; }
  // Host seconds in a device second, less 1.
  double drift() const { return drift_; }
  // Earliest host time at which a frame of this device time could arrive.
  std::int64_t host_ns(std::int64_t device_us) const;
  std::size_t blocks() const { return points_.size(); }

 private:
  struct Point {
    std::int64_t device_us = 0, late_ns = 0;  // late: host less device time
  };
  void fit();

  bool begun_ = false, block_begun_ = false;
  std::uint32_t last_ = 0;
  std::int64_t device_us_ = 0, first_arrival_ns_ = 0;
  Point open_;  // of the incomplete block
  std::int64_t block_end_us_ = 0;
  std::deque<Point> points_;
  double drift_ = 0, late_at_0_ns_ = 0;
};

}  // namespace twinrate
