#include "import/whole_log.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "core/config.hpp"

namespace twinrate {

WholeLog::WholeLog(const std::string& path) : path_(path), part_path_(path + ".part") {
  // A rename would replace a device or directory.
  if (std::filesystem::exists(path) && !std::filesystem::is_regular_file(path))
    throw BadInput(fmt::format("{}: is not a plain file; give a file name", path));
  log_ = lcm_eventlog_create(part_path_.c_str(), "w");
  if (!log_) throw BadInput(fmt::format("{}: cannot be written: {}", path, std::strerror(errno)));
}

WholeLog::~WholeLog() {
  if (!log_) return;
  lcm_eventlog_destroy(log_);
  std::remove(part_path_.c_str());
}

void WholeLog::write_bytes(const char* channel, std::int64_t timestamp_us) {
  lcm_eventlog_event_t event{};
  event.timestamp = timestamp_us;
  event.channel = const_cast<char*>(channel);
  event.channellen = static_cast<std::int32_t>(std::strlen(channel));
  event.data = bytes_.data();
  event.datalen = static_cast<std::int32_t>(bytes_.size());
  if (lcm_eventlog_write_event(log_, &event) != 0) fail_to_write();
}

void WholeLog::finish() {
  if (std::fflush(log_->f) != 0 || std::ferror(log_->f)) fail_to_write();
  lcm_eventlog_destroy(log_);
  log_ = nullptr;
  if (std::rename(part_path_.c_str(), path_.c_str()) == 0) return;
  const int error = errno;
  std::remove(part_path_.c_str());
  throw BadInput(fmt::format("{}: cannot be written: {}", path_, std::strerror(error)));
}

void WholeLog::fail_to_write() const {
  throw std::runtime_error(fmt::format("{}: cannot be written: {}", path_, std::strerror(errno)));
}

}  // namespace twinrate
