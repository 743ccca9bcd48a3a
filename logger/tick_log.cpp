#include "logger/tick_log.hpp"

#include <algorithm>

#include "core/decode.hpp"
#include "core/rates.hpp"

namespace twinrate {

TickLog::TickLog(LogWriter& writer, Order order, const DriveConfig& drive,
                 const std::string& channel_suffix, std::int64_t t0_us)
    : writer_(writer),
      order_(order),
      drive_(drive),
      t0_us_(t0_us),
      rates_(drive.gain.policy, drive.background_rate()),
      gain_rate_(drive.background_rate()) {
  if (drive_.locks_first()) gain_rate_.from = BackgroundRate::kNotYet;
  for (const ChannelInfo& channel : kChannels)
    names_[static_cast<std::size_t>(channel.channel)] = channel.name + channel_suffix;
}

bool TickLog::expected(int channel, const Tick& tick, bool while_unknown) const {
  if (static_cast<Channel>(channel) == Channel::kTruth)  // a real drive has none
    return drive_.plant.kind == PlantKind::kSimulated;
  return static_cast<Channel>(channel) != Channel::kGain || tick.sends_gain.value_or(while_unknown);
}

TickLog::Tick TickLog::new_tick(std::int64_t k) const {
  Tick tick;
  if (!drive_.locks_first()) tick.sends_gain = rates_.sends_gain(k, 0);
  return tick;
}

// An estimate that comes again is older than the change of the rate.
void TickLog::note_rate(std::int64_t k, const std::uint8_t* bytes, std::size_t size) {
  const bool every_tick = estimate_status(bytes, size) & kGainEveryTick;
  if (every_tick && k >= gain_rate_.from) gain_rate_.from = BackgroundRate::kNotYet;
  if (!every_tick && gain_rate_.from == BackgroundRate::kNotYet)
    gain_rate_.from = k / gain_rate_.n * gain_rate_.n;
}

bool TickLog::complete(const Tick& tick) const {
  for (int c = 0; c < kTickChannels; ++c)
    if (expected(c, tick, true) && tick.bytes[static_cast<std::size_t>(c)].empty()) return false;
  return true;
}

void TickLog::write(Channel channel, std::int64_t t_ns, const std::uint8_t* bytes,
                    std::size_t size) {
  t_ns_ = std::max(t_ns_, t_ns);
  writer_.write(names_[static_cast<std::size_t>(channel)], bytes, size, t0_us_ + t_ns_ / 1000);
}

void TickLog::write_tick(const Tick& tick) {
  for (int c = 0; c < kTickChannels; ++c) {
    const auto& bytes = tick.bytes[static_cast<std::size_t>(c)];
    if (!bytes.empty()) write(static_cast<Channel>(c), tick.t_ns, bytes.data(), bytes.size());
  }
}

bool TickLog::new_as_it_comes(Channel channel, std::int64_t seq) {
  ChannelAccount& account = accounts_[static_cast<std::size_t>(channel)];
  const bool begins =
      account.last_seq < 0 || (seq <= account.first_seq && account.last_seq > account.first_seq);
  if (!begins && seq <= account.last_seq) {
    ++account.duplicates;
    return false;
  }
  if (begins)
    account.first_seq = seq;
  else
    account.lost +=
        (channel == Channel::kGain ? rates_.gains_between(account.last_seq, seq, gain_rate_)
                                   : seq - account.last_seq) -
        1;
  account.last_seq = seq;
  if (channel == Channel::kMeasurement) next_ = seq + 1;
  return true;
}

bool TickLog::take(Channel channel, std::int64_t seq, std::int64_t t_ns, const std::uint8_t* bytes,
                   std::size_t size) {
  const bool of_a_tick = channel < Channel::kStatus;
  if (channel == Channel::kEstimate && drive_.locks_first()) note_rate(seq, bytes, size);
  if (order_ == Order::kByTick && of_a_tick) return take_by_tick(channel, seq, t_ns, bytes, size);
  if (of_a_tick && !new_as_it_comes(channel, seq)) return true;
  ++accounts_[static_cast<std::size_t>(channel)].received;
  if (channel == Channel::kMeasurement) writer_.mark(seq);
  // Events and heartbeats may carry an earlier drive time; the time of the log never decreases.
  write(channel, of_a_tick ? t_ns : t_ns_, bytes, size);
  return true;
}

bool TickLog::take_by_tick(Channel channel, std::int64_t seq, std::int64_t t_ns,
                           const std::uint8_t* bytes, std::size_t size) {
  if (seq >= next_ + ahead_) return false;
  ChannelAccount& account = accounts_[static_cast<std::size_t>(channel)];
  const bool done = seq < next_;
  if (!done) pending_.try_emplace(seq, new_tick(seq));
  if (done || !expected(static_cast<int>(channel), pending_[seq], true)) {
    ++account.duplicates;
    return true;
  }
  Tick& tick = pending_[seq];
  const auto& held = tick.bytes[static_cast<std::size_t>(channel)];
  const bool same = std::equal(held.begin(), held.end(), bytes, bytes + size);
  if (!ordered_) tick.in_turn = true;
  const bool begins = channel == Channel::kMeasurement && !tick.in_turn;
  if (!held.empty() && (same || !begins)) {
    ++account.duplicates;
    if (begins) tick.in_turn = in_turn(seq);
    write_complete();
    return true;
  }
  if (begins) {
    begin(seq);
    tick.in_turn = in_turn(seq);
  }
  ++account.received;
  account.last_seq = std::max(account.last_seq, seq);
  tick.t_ns = t_ns;
  tick.bytes[static_cast<std::size_t>(channel)].assign(bytes, bytes + size);
  if (channel == Channel::kEstimate && drive_.locks_first())
    tick.sends_gain = rates_.sends_gain(seq, estimate_status(bytes, size));
  auto& gain = tick.bytes[static_cast<std::size_t>(Channel::kGain)];
  if (!tick.sends_gain.value_or(true)) gain.clear();
  write_complete();
  return true;
}

void TickLog::begin(std::int64_t seq) {
  pending_[seq] = new_tick(seq);
  const auto after = pending_.find(seq + 1);
  if (after != pending_.end()) after->second.in_turn = false;
}

bool TickLog::in_turn(std::int64_t seq) const {
  const auto before = pending_.find(seq - 1);
  return seq == next_ ||
         (before != pending_.end() &&
          !before->second.bytes[static_cast<std::size_t>(Channel::kCommand)].empty());
}

void TickLog::write_complete() {
  for (auto first = pending_.begin(); first != pending_.end() && first->first == next_ &&
                                      first->second.in_turn && complete(first->second);
       first = pending_.erase(first), ++next_) {
    write_tick(first->second);
    writer_.mark(next_ + 1);
  }
}

std::vector<TickLog::Missing> TickLog::missing(std::size_t limit) const {
  std::vector<Missing> list;
  if (pending_.empty()) return list;
  const std::int64_t newest = pending_.rbegin()->first;
  Tick nothing;
  for (std::int64_t k = next_; k <= newest; ++k) {
    const auto found = pending_.find(k);
    const Tick& tick = found == pending_.end() ? nothing = new_tick(k) : found->second;
    for (int c = 0; c < kTickChannels; ++c) {
      const bool too_early =
          k == next_ && c == static_cast<int>(Channel::kMeasurement) && !tick.in_turn;
      if (!expected(c, tick, false) ||
          (!tick.bytes[static_cast<std::size_t>(c)].empty() && !too_early))
        continue;
      if (list.size() == limit) return list;
      list.push_back({static_cast<Channel>(c), k});
    }
  }
  return list;
}

void TickLog::close() {
  for (const auto& [k, tick] : pending_) write_tick(tick);
  for (const Missing& gone : missing(static_cast<std::size_t>(-1))) {
    ChannelAccount& account = accounts_[static_cast<std::size_t>(gone.channel)];
    if (gone.seq < account.last_seq) ++account.lost;
  }
  pending_.clear();
}

}  // namespace twinrate
