// Statistics of one channel: count, rate, gaps, latency after the MEASUREMENT that caused a
// message.
//
// Only the common header of a message is decoded (fingerprint, seq, t_ns, session; big-endian, 8
// bytes each), which is fast enough for a lock-step run at full speed. The newest message is
// stored.
//
// GAIN comes every n ticks, and n changes: a gain every tick before the filter agrees with itself,
// and requests. A gain whose first use lies beyond the next tick shows when the next one is due; a
// later one is a gap. Without this sign (policy immediate) a distance larger than before is a gap
// if the next one is as before again, else the new n.
#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

struct MessageHeader {
  std::int64_t seq, t_ns, session;
};
// Empty if the message is shorter than the header.
std::optional<MessageHeader> read_header(const std::uint8_t* bytes, std::size_t size);

// Arrival times of MEASUREMENT for the last ticks, microseconds.
class TickTimes {
 public:
  void note(std::int64_t seq, std::int64_t arrival_us);
  // Empty if MEASUREMENT(seq) is not among the last ticks.
  std::optional<std::int64_t> find(std::int64_t seq) const;

 private:
  struct Entry {
    std::int64_t seq = -1, arrival_us = 0;
  };
  std::array<Entry, 4096> ring_;
};

class WatchedChannel {
 public:
  explicit WatchedChannel(Channel channel) : channel_(channel) {}

  void take(const MessageHeader& header, const std::uint8_t* bytes, std::size_t size,
            std::int64_t arrival_us, const TickTimes& ticks);
  // Starts the next interval of rate and latency.
  void begin_interval(std::int64_t now_us);
  void reset();
  // GAIN: none is due from now on (policy scheduled); the next one follows no gap.
  void pause() { paused_ = true; }

  Channel channel() const { return channel_; }
  std::int64_t messages() const { return messages_; }
  // Missing sequence numbers; a late one (a repeat may overtake) no longer counts.
  std::int64_t gaps() const { return gaps_; }
  std::int64_t repeats() const { return repeats_; }  // repeated sequence numbers
  std::int64_t last_seq() const { return last_seq_; }
  std::int64_t last_t_ns() const { return last_t_ns_; }
  bool has_interval() const { return interval_start_us_ > 0; }  // begin_interval() was called
  double rate_Hz(std::int64_t now_us) const;                    // over the present interval
  double age_s(std::int64_t now_us) const;                      // since the newest message
  std::optional<double> latency_us() const;                     // mean of the interval
  double latency_max_us() const { return latency_max_us_; }
  const std::vector<std::uint8_t>& newest() const { return newest_; }

 private:
  void count_sequence(std::int64_t seq);
  bool comes_late(std::int64_t seq) const;
  void count_gain_gaps(std::int64_t step);

  Channel channel_;
  std::int64_t messages_ = 0, gaps_ = 0, repeats_ = 0;
  std::int64_t first_seq_ = -1, last_seq_ = -1, last_t_ns_ = 0, last_arrival_us_ = 0;
  std::array<std::int64_t, 256> seen_ = {};  // the last sequence numbers + 1
  // Of GAIN: ticks to the next one by the last one, ticks between the last ones, and the
  // distance that may be a gap.
  bool paused_ = false;
  std::int64_t told_ = 0, stride_ = 0, doubtful_ = 0;
  std::int64_t interval_start_us_ = 0, interval_messages_ = 0;
  double latency_sum_us_ = 0, latency_max_us_ = 0;
  std::int64_t latency_count_ = 0;
  std::vector<std::uint8_t> newest_;
};

}  // namespace twinrate
