// Writes the messages of a run to the log and keeps account of the missing ones.
//
// Ordered (lock-step): a tick is written when all its messages are there, in the order of
// core/channels. Missing messages can be requested again, so the log of a run does not depend on
// scheduling or on lost datagrams. Time stamps are drive time, so lcm-logplayer at x1 plays at the
// speed of the real drive.
// In order of arrival (realtime, foreign sessions): written at once; gaps of the sequence numbers
// count as losses. A session that begins with its first number again (a log played twice) is
// written again.
#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/drive_config.hpp"
#include "logger/log_writer.hpp"

namespace twinrate {

struct ChannelAccount {
  std::int64_t received = 0, lost = 0, duplicates = 0, first_seq = -1, last_seq = -1;
};

class TickLog {
 public:
  enum class Order { kByTick, kAsItComes };
  // `drive` says which ticks have a GAIN; it must outlive this. `t0_us`: wall time of drive time
  // 0.
  TickLog(LogWriter& writer, Order order, const DriveConfig& drive, std::string channel_suffix,
          std::int64_t t0_us);

  void take(Channel channel, std::int64_t seq, std::int64_t t_ns, const std::uint8_t* bytes,
            std::size_t size);
  // Every tick below this one is handed to the writer, whole.
  std::int64_t complete_below() const { return next_; }
  // Missing messages of ticks that later messages have overtaken, at most `limit` entries.
  struct Missing {
    Channel channel;
    std::int64_t seq;
  };
  std::vector<Missing> missing(std::size_t limit) const;
  // End of the run: writes the messages of incomplete ticks and counts their gaps as lost. Messages
  // that a stopped run had not sent yet are not lost.
  void close();

  const ChannelAccount& account(Channel channel) const {
    return accounts_[static_cast<std::size_t>(channel)];
  }

 private:
  static constexpr int kTickChannels = static_cast<int>(Channel::kStatus);
  struct Tick {
    std::int64_t t_ns = 0;
    std::array<std::vector<std::uint8_t>, kTickChannels> bytes;
  };

  bool expected(int channel, std::int64_t k) const;
  bool complete(std::int64_t k, const Tick& tick) const;
  void write_tick(const Tick& tick);
  void write(Channel channel, std::int64_t t_ns, const std::uint8_t* bytes, std::size_t size);
  bool new_as_it_comes(Channel channel, std::int64_t seq);

  LogWriter& writer_;
  Order order_;
  const DriveConfig& drive_;
  std::array<std::string, kChannelCount> names_;
  std::int64_t t0_us_, next_ = 0, t_ns_ = 0;
  std::map<std::int64_t, Tick> pending_;
  std::array<ChannelAccount, kChannelCount> accounts_{};
};

}  // namespace twinrate
