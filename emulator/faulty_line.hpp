// One direction of a line between drive and host, with faults. The caller gives the time in ns: no
// function reads a clock, and equal seeds give equal faults.
//
//   wire time   10 bits a byte at `baud`; a frame waits until the previous frame has left, in a
//               buffer of kBuffer bytes (like a serial port of Linux); a frame that does not fit is
//               lost
//   latency     constant, and jitter uniform in 0 .. jitter; a byte line keeps its order
//   reordered   a frame is delivered after the next one (datagrams)
//   pulled      no frame passes from pulled_at on, for pulled_for
#pragma once
#include <cstdint>
#include <deque>
#include <random>
#include <span>
#include <vector>

namespace twinrate {

struct LineFaults {
  double bit_errors = 0;                        // share of the bits
  double lost = 0, doubled = 0, reordered = 0;  // shares of the frames
  double latency_s = 0, jitter_s = 0;
  double pulled_at_s = 1e9, pulled_for_s = 1e9;
  double from_s = 0;   // start of the shares above
  int baud = 0;        // 0: no wire time
  bool waits = false;  // the sender waits for room in the buffer: no frame is lost there
};

class FaultyLine {
 public:
  static constexpr double kBuffer = 4096;

  FaultyLine(const LineFaults& faults, unsigned seed) : faults_(faults), random_(seed) {}

  // One frame (a datagram) leaves the sender.
  void send(std::span<const std::uint8_t> frame, std::int64_t t_ns);
  // The bytes that have arrived by now.
  std::vector<std::uint8_t> receive(std::int64_t t_ns);
  // Earliest arrival of the frames on the line; INT64_MAX: none.
  std::int64_t next_arrival() const;
  // Number of faults so far.
  std::int64_t made() const { return made_; }
  // Makes exactly one fault at the next frame, of a kind with a share above 0.
  void fault_now() { now_ = true; }

 private:
  using Frame = std::vector<std::uint8_t>;
  bool happens(double share);
  bool pulled(std::int64_t t_ns) const;
  void put(Frame frame, std::int64_t t_ns);

  struct OnTheWay {
    std::int64_t arrival_ns;
    Frame frame;
  };
  LineFaults faults_;
  std::mt19937_64 random_;
  std::deque<OnTheWay> on_the_way_;
  Frame held_;
  std::int64_t busy_until_ns_ = 0, last_arrival_ns_ = 0, made_ = 0;
  bool now_ = false;
};

}  // namespace twinrate
