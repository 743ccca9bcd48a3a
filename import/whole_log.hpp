// Writes an LCM log atomically: the file exists only after finish(). With a manifest it has
// the marks of core/log_marks.hpp.
#pragma once
#include <lcm/eventlog.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/channels.hpp"
#include "core/log_marks.hpp"
#include "core/output_file.hpp"

namespace twinrate {

// Throws BadInput if the file cannot be created, std::runtime_error if the disk is full.
class WholeLog {
 public:
  explicit WholeLog(const std::string& path);
  ~WholeLog();
  WholeLog(const WholeLog&) = delete;
  WholeLog& operator=(const WholeLog&) = delete;

  // `timestamp_us` of the event: above 0, never decreasing.
  template <class Message>
  void write(const Message& message, std::int64_t timestamp_us) {
    bytes_.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes_.data(), 0, static_cast<int>(bytes_.size()));
    write_bytes(info(kChannelOf<Message>).name, timestamp_us);
    if (kChannelOf<Message> == Channel::kManifest && !std::exchange(begun_, true))
      mark(kLogBegins, timestamp_us);
  }
  void finish();

 private:
  void write_bytes(const char* channel, std::int64_t timestamp_us);
  void mark(std::string_view text, std::int64_t timestamp_us);

  PartFile part_;
  lcm_eventlog_t* log_ = nullptr;
  std::vector<std::uint8_t> bytes_;
  std::int64_t timestamp_us_ = 0;  // of the last event
  bool begun_ = false;             // a manifest was written
};

}  // namespace twinrate
