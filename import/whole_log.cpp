#include "import/whole_log.hpp"

#include <cstdio>
#include <cstring>

namespace twinrate {

WholeLog::WholeLog(const std::string& path)
    : part_(path), log_(lcm_eventlog_create(part_.part_path().c_str(), "w")) {
  if (!log_) part_.fail();
}

WholeLog::~WholeLog() {
  if (log_) lcm_eventlog_destroy(log_);
}

void WholeLog::write_bytes(const char* channel, std::int64_t timestamp_us) {
  lcm_eventlog_event_t event{};
  event.timestamp = timestamp_us_ = timestamp_us;
  event.channel = const_cast<char*>(channel);
  event.channellen = static_cast<std::int32_t>(std::strlen(channel));
  event.data = bytes_.data();
  event.datalen = static_cast<std::int32_t>(bytes_.size());
  if (lcm_eventlog_write_event(log_, &event) != 0) part_.fail();
}

void WholeLog::mark(std::string_view text, std::int64_t timestamp_us) {
  bytes_.assign(text.begin(), text.end());
  write_bytes(std::string(kLogMarkChannel).c_str(), timestamp_us);
}

void WholeLog::finish() {
  if (begun_) mark(kLogEnds, timestamp_us_);
  if (std::fflush(log_->f) != 0 || std::ferror(log_->f)) part_.fail();
  lcm_eventlog_destroy(log_);
  log_ = nullptr;
  part_.finish();
}

}  // namespace twinrate
