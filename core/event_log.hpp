// Reads LCM logs of unknown origin. Every reader of this project uses it instead of liblcm's
// reader, which allocates any length that a damaged log contains.
//
// An event is whole if it begins with the sync word, its lengths lie within the file and within
// kMaxMessageBytes, its number follows the one before, its time stamp does not fall or jump by a
// day, and, on a channel of the drive, its message decodes (core/message_check.hpp), its drive time
// is that of its tick, and its tick does not decrease. A part that begins must end
// (core/log_marks.hpp). At the end the messages are counted against manifest.json beside the log,
// if it has counts. Any violation is damage, reported with event and byte. Memory: one event.
#pragma once
#include <array>
#include <cstdint>
#include <cstdio>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/config.hpp"

namespace twinrate {

// Between two time stamps; a longer one is damage.
inline constexpr std::int64_t kLongestGap_us = 86'400'000'000;

enum class OnDamage { kRefuse, kSkip };  // throw BadInput, or use the events that are whole

// The parts of a log in order: log.lcm, log-001.lcm .. of a run directory, or the one file. Throws
// BadInput.
std::vector<std::string> log_parts(const std::string& path);

class EventLog {
 public:
  // `path`: a run directory or a log file. `channel_suffix`: of the drive; empty: that of the first
  // event, if it is a manifest. Throws BadInput if there is no such log.
  EventLog(const std::string& path, OnDamage on_damage, const std::string& channel_suffix = "");

  // The next whole event; null at the end. Valid until the next call. Throws BadInput at damage.
  const lcm::LogEvent* next();
  // The channel of the event; none if it is not one of this drive.
  std::optional<Channel> channel() const { return channel_; }
  const std::string& suffix() const { return suffix_; }
  double share_read() const;
  // The skipped damage: the first place and the number of places; "" if there was none.
  std::string damage() const;
  // Messages of the drive so far, by channel.
  const std::array<std::int64_t, kChannelCount>& counts() const { return counts_; }

  // At the end: whether manifest.json beside the log has the counts of the whole log.
  bool counted() const { return counted_; }

  // The position of the event that next() returned last, and the way back to it.
  struct Place {
    std::size_t part = 0;
    std::int64_t byte = 0;
  };
  Place place() const { return place_; }
  void go_to(const Place& place);

 private:
  struct Header {
    std::int64_t number = 0, timestamp = 0, channel_bytes = 0, data_bytes = 0;
  };
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  struct TickOrder {
    std::int64_t first = -1, last = -1;
    bool fell = false;
  };

  bool open_part(std::size_t part, std::int64_t byte);
  std::string read_header(std::int64_t byte, Header& header);  // returns the error
  std::string read_event(std::int64_t byte);
  std::string wrong_order();
  std::string wrong_content();
  std::string wrong_time(std::int64_t seq, std::int64_t t_ns) const;
  bool goes_back(Channel channel, std::int64_t seq);
  void take_manifest();
  bool take_mark();  // false if it is none
  void note(std::int64_t byte, const std::string& what);
  std::int64_t next_whole(std::int64_t byte);  // possible start of an event; the size at the end
  void end_of_part();
  void end_of_log();
  void compare_counts();

  std::string path_, suffix_;
  OnDamage on_damage_;
  std::vector<std::string> parts_;
  std::vector<std::int64_t> bytes_;  // of each part
  std::unique_ptr<std::FILE, Close> file_;
  std::size_t part_ = 0;
  std::int64_t at_ = 0;  // byte of the next event
  Place place_;
  Header header_;
  lcm::LogEvent event_{};
  std::vector<std::uint8_t> data_;
  std::map<std::string, Channel> names_;
  std::optional<Channel> channel_;
  std::optional<std::int64_t> last_number_, last_timestamp_;
  std::array<TickOrder, kChannelCount> order_;
  std::array<std::int64_t, kChannelCount> counts_{};
  std::optional<DriveConfig> drive_;  // of the manifest
  // By the marks: the present part has begun and not ended; it ended and continues in the next one;
  // the error at the end of the part before.
  bool open_ = false, continues_ = false;
  std::string end_missing_;
  bool jumped_ = false, ended_ = false, counted_ = false;
  std::string first_damage_;
  std::int64_t damaged_ = 0;
};

}  // namespace twinrate
