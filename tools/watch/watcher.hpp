// Subscribes to all channels of a drive and keeps their statistics, for `twinrate watch`.
//
// Follows one session: the first one received, and another one after 1 s of silence. Messages of
// other sessions are counted. The socket buffer is large and read every few milliseconds, so that the
// watcher neither loses messages nor slows the drive.
#pragma once
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/bus.hpp"
#include "core/watched_channel.hpp"

namespace twinrate {

struct WatchedEvent {
  std::int64_t seq = -1;
  std::string role, reason, text;
};

class Watcher {
 public:
  // `url`: from resolve_url(). Throws MachineError if LCM does not work on this machine.
  Watcher(const std::string& url, const std::string& channel_suffix);

  // Handles the messages that arrive within `timeout_ms`, and all that are queued.
  void listen(int timeout_ms);

  std::vector<WatchedChannel>& channels() { return channels_; }
  const std::vector<WatchedChannel>& channels() const { return channels_; }
  const std::map<int, status_t>& processes() const { return processes_; }  // by role, newest status
  const std::deque<WatchedEvent>& events() const { return events_; }  // the last few, oldest first
  std::int64_t session() const { return session_; }
  // Messages of other sessions, and those of ticks that cannot be.
  std::int64_t foreign() const { return bus_.counters().refused; }
  std::int64_t undecodable() const { return undecodable_ + bus_.counters().undecodable; }
  std::int64_t heard() const { return heard_; }  // messages of the session followed
  double silent_s() const;                       // since the last message, or since the start

 private:
  void take(Channel channel, const std::uint8_t* bytes, std::size_t size);
  void begin(std::int64_t session);
  void keep_event(const std::uint8_t* bytes, int size);
  void keep_status(const std::uint8_t* bytes, int size);

  Bus bus_;
  std::vector<WatchedChannel> channels_;
  TickTimes tick_times_;
  std::map<int, status_t> processes_;
  std::deque<WatchedEvent> events_;
  std::int64_t session_ = 0, undecodable_ = 0, heard_ = 0;
  std::int64_t last_heard_us_;
};

std::int64_t wall_clock_us();

}  // namespace twinrate
