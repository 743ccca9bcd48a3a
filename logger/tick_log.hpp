// Writes the messages of a run to the log and counts missing ones.
//
// Ordered (lock-step): a tick is written when all its messages have arrived, in the order of
// core/channels. Missing messages can be requested again, so the log does not depend on scheduling
// or lost datagrams. As it comes (realtime, foreign sessions): messages are written at once; losses
// follow from the sequence numbers; a session that restarts at its first number (a log replayed
// twice) is written again. Time stamps are drive time, so lcm-logplayer at speed 1 plays at the
// speed of the drive.
#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/drive_config.hpp"
#include "core/rate_history.hpp"
#include "logger/log_writer.hpp"

namespace twinrate {

struct ChannelAccount {
  std::int64_t received = 0, lost = 0, duplicates = 0, first_seq = -1, last_seq = -1;
};

class TickLog {
 public:
  enum class Order { kByTick, kAsItComes };
  // `drive` defines the ticks with a GAIN and must outlive this object. `t0_us`: wall time of drive
  // time 0.
  TickLog(LogWriter& writer, Order order, const DriveConfig& drive,
          const std::string& channel_suffix, std::int64_t t0_us);

  // False for a message of a tick too far ahead, because nobody can send the ticks between again.
  // The first message of a tick and channel counts. A MEASUREMENT begins its tick: a message before
  // it had no cause and must be sent again. The same holds for a MEASUREMENT before the COMMAND of
  // the tick before: it counts if it comes again, and another one replaces it.
  bool take(Channel channel, std::int64_t seq, std::int64_t t_ns, const std::uint8_t* bytes,
            std::size_t size);
  // The messages come over several ports and in no certain order: the first of a tick and channel
  // counts whenever it comes.
  void expect_no_order() { ordered_ = false; }
  // Largest number of ticks above complete_below() that take() admits by tick.
  void admit_ahead(std::int64_t ticks) { ahead_ = ticks; }
  // Rate and policy change while the drive runs. To be called before a message of a changed tick
  // comes.
  void follow(RateHistory rates) { rates_ = std::move(rates); }
  // Tells when GAIN is due, from the estimates received so far.
  BackgroundRate gain_rate() const { return gain_rate_; }
  // All ticks below this one are complete and passed to the writer.
  std::int64_t complete_below() const { return next_; }
  // Missing messages of ticks for which later messages have arrived, at most `limit` entries.
  struct Missing {
    Channel channel;
    std::int64_t seq;
  };
  std::vector<Missing> missing(std::size_t limit) const;
  // End of the run: writes incomplete ticks and counts their missing messages as lost, up to the
  // last message received on each channel.
  void close();

  const ChannelAccount& account(Channel channel) const {
    return accounts_[static_cast<std::size_t>(channel)];
  }

 private:
  static constexpr int kTickChannels = static_cast<int>(Channel::kStatus);
  struct Tick {
    std::int64_t t_ns = 0;
    bool in_turn = false;  // its MEASUREMENT came after the COMMAND of the tick before
    // Whether a GAIN belongs to it; empty until its ESTIMATE has come.
    std::optional<bool> sends_gain;
    std::array<std::vector<std::uint8_t>, kTickChannels> bytes;
  };

  bool take_by_tick(Channel channel, std::int64_t seq, std::int64_t t_ns, const std::uint8_t* bytes,
                    std::size_t size);
  // Empties the tick for its MEASUREMENT; that of the next tick came too early.
  void begin(std::int64_t seq);
  // Whether the COMMAND that causes the tick is there.
  bool in_turn(std::int64_t seq) const;
  void write_complete();
  bool expected(int channel, const Tick& tick, bool while_unknown) const;
  Tick new_tick(std::int64_t k) const;
  void note_rate(std::int64_t k, const std::uint8_t* bytes, std::size_t size);
  bool complete(const Tick& tick) const;
  void write_tick(const Tick& tick);
  void write(Channel channel, std::int64_t t_ns, const std::uint8_t* bytes, std::size_t size);
  bool new_as_it_comes(Channel channel, std::int64_t seq);

  LogWriter& writer_;
  Order order_;
  const DriveConfig& drive_;
  std::array<std::string, kChannelCount> names_;
  std::int64_t t0_us_, next_ = 0, t_ns_ = 0, ahead_ = std::int64_t{1} << 20;
  bool ordered_ = true;
  RateHistory rates_;
  BackgroundRate gain_rate_;  // up to the first change
  std::map<std::int64_t, Tick> pending_;
  std::array<ChannelAccount, kChannelCount> accounts_{};
};

}  // namespace twinrate
