#include "core/watched_channel.hpp"

#include <algorithm>
#include <utility>

namespace twinrate {
namespace {

std::int64_t big_endian_64(const std::uint8_t* bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < 8; ++i) value = value << 8 | bytes[i];
  return static_cast<std::int64_t>(value);
}

constexpr std::size_t kFirstUseAt = 32;  // first_use_seq of gain_t, after the header

// True for channels with one message a tick.
bool ticks(Channel channel) {
  return channel == Channel::kMeasurement || channel == Channel::kTruth ||
         channel == Channel::kEstimate || channel == Channel::kReference ||
         channel == Channel::kCommand;
}

bool follows_measurement(Channel channel) {
  return channel == Channel::kEstimate || channel == Channel::kGain || channel == Channel::kCommand;
}

}  // namespace

std::optional<MessageHeader> read_header(const std::uint8_t* bytes, std::size_t size) {
  if (size < 32) return {};
  return MessageHeader{.seq = big_endian_64(bytes + 8),
                       .t_ns = big_endian_64(bytes + 16),
                       .session = big_endian_64(bytes + 24)};
}

void TickTimes::note(std::int64_t seq, std::int64_t arrival_us) {
  if (seq >= 0) ring_[static_cast<std::size_t>(seq) % ring_.size()] = {seq, arrival_us};
}

std::optional<std::int64_t> TickTimes::find(std::int64_t seq) const {
  if (seq < 0) return {};
  const Entry& entry = ring_[static_cast<std::size_t>(seq) % ring_.size()];
  if (entry.seq != seq) return {};
  return entry.arrival_us;
}

void WatchedChannel::take(const MessageHeader& header, const std::uint8_t* bytes, std::size_t size,
                          std::int64_t arrival_us, const TickTimes& tick_times) {
  ++messages_;
  ++interval_messages_;
  last_arrival_us_ = arrival_us;
  newest_.assign(bytes, bytes + size);
  if (follows_measurement(channel_)) {
    if (const auto cause = tick_times.find(header.seq)) {
      const double latency_us = static_cast<double>(arrival_us - *cause);
      latency_sum_us_ += latency_us;
      latency_max_us_ = std::max(latency_max_us_, latency_us);
      ++latency_count_;
    }
  }
  const bool newest = header.seq > last_seq_;
  if (ticks(channel_) || channel_ == Channel::kGain) count_sequence(header.seq);
  if (channel_ == Channel::kGain && newest && size >= kFirstUseAt + 8)
    told_ = big_endian_64(bytes + kFirstUseAt) - header.seq;
  last_seq_ = std::max(last_seq_, header.seq);
  last_t_ns_ = header.t_ns;
}

bool WatchedChannel::comes_late(std::int64_t seq) const {
  const auto kept = static_cast<std::int64_t>(seen_.size());
  return channel_ != Channel::kGain && seq > first_seq_ && seq > last_seq_ - kept &&
         seen_[static_cast<std::size_t>(seq % kept)] != seq + 1;
}

void WatchedChannel::count_sequence(std::int64_t seq) {
  if (seq < 0) return;
  const bool late = comes_late(seq);
  seen_[static_cast<std::size_t>(seq) % seen_.size()] = seq + 1;
  if (last_seq_ < 0) {
    first_seq_ = seq;
    return;
  }
  const std::int64_t step = seq - last_seq_;
  if (step <= 0) {
    if (late)
      --gaps_;
    else
      ++repeats_;
    return;
  }
  if (channel_ == Channel::kGain)
    count_gain_gaps(step);
  else
    gaps_ += step - 1;
}

void WatchedChannel::count_gain_gaps(std::int64_t step) {
  if (std::exchange(paused_, false)) {
    stride_ = doubtful_ = 0;
    return;
  }
  if (told_ > 1) {
    if (step > told_) gaps_ += std::max<std::int64_t>(1, step / told_ - 1);
    stride_ = doubtful_ = 0;
    return;
  }
  if (doubtful_ > 0 && step == stride_) gaps_ += doubtful_ / stride_ - 1;
  const bool doubtful = stride_ > 0 && step > stride_ && step != doubtful_;
  if (!doubtful) stride_ = step;
  doubtful_ = doubtful ? step : 0;
}

void WatchedChannel::begin_interval(std::int64_t now_us) {
  interval_start_us_ = now_us;
  interval_messages_ = latency_count_ = 0;
  latency_sum_us_ = latency_max_us_ = 0;
}

void WatchedChannel::reset() {
  *this = WatchedChannel(channel_);
}

double WatchedChannel::rate_Hz(std::int64_t now_us) const {
  const double elapsed_s = 1e-6 * static_cast<double>(now_us - interval_start_us_);
  return elapsed_s > 0 ? static_cast<double>(interval_messages_) / elapsed_s : 0;
}

double WatchedChannel::age_s(std::int64_t now_us) const {
  return std::max(0.0, 1e-6 * static_cast<double>(now_us - last_arrival_us_));
}

std::optional<double> WatchedChannel::latency_us() const {
  if (latency_count_ == 0) return {};
  return latency_sum_us_ / static_cast<double>(latency_count_);
}

}  // namespace twinrate
