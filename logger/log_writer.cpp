#include "logger/log_writer.hpp"

#include <fmt/format.h>
#include <stdio_ext.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "core/output_file.hpp"

namespace twinrate {

LogWriter::LogWriter(std::string directory, std::int64_t rotate_bytes, std::size_t first_part)
    : directory_(std::move(directory)), rotate_bytes_(rotate_bytes), first_part_(first_part) {
  std::error_code refused;  // open_next() then fails, too
  std::filesystem::create_directories(directory_, refused);
  open_next();
}

LogWriter::~LogWriter() {
  flush();
  close();
}

void LogWriter::open_next() {
  const std::size_t part = first_part_ + files_.size();
  const std::string name = part == 0 ? "log.lcm" : fmt::format("log-{:03}.lcm", part);
  const std::string path = (std::filesystem::path(directory_) / name).string();
  create_new(path);
  log_ = lcm_eventlog_create(path.c_str(), "w");
  if (!log_)
    throw std::runtime_error(fmt::format("{}: cannot be written: {}", path, std::strerror(errno)));
  files_.push_back(path);
  written_ = on_disk_ = 0;
}

void LogWriter::fail(const std::string& why) {
  full_ = true;
  if (failure_.empty()) failure_ = why;
}

void LogWriter::close() {
  if (log_) lcm_eventlog_destroy(log_);
  log_ = nullptr;
}

void LogWriter::set_manifest(const std::string& channel, const std::vector<std::uint8_t>& bytes,
                             std::int64_t t_us) {
  manifest_channel_ = channel;
  manifest_ = bytes;
  put(channel, bytes.data(), bytes.size(), t_us);
}

bool LogWriter::put(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
                    std::int64_t t_us) {
  if (full_) return false;
  lcm_eventlog_event_t event{};
  event.timestamp = t_us;
  event.channellen = static_cast<int>(channel.size());
  event.channel = const_cast<char*>(channel.c_str());
  event.datalen = static_cast<int>(size);
  event.data = const_cast<std::uint8_t*>(bytes);
  if (lcm_eventlog_write_event(log_, &event) != 0) {
    fail(files_.back() + ": the disk is full");
    flush();
    return false;
  }
  written_ += 28 + static_cast<std::int64_t>(channel.size() + size);
  return written_ - on_disk_ < kFlushBytes || flush();
}

bool LogWriter::write(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
                      std::int64_t t_us) {
  if (written_ > rotate_bytes_) {
    if (!flush()) return false;
    close();
    try {
      open_next();
    } catch (const std::runtime_error& refused) {
      fail(refused.what());
      return false;
    }
    rotated_ = true;
    if (!manifest_.empty()) put(manifest_channel_, manifest_.data(), manifest_.size(), t_us);
  }
  return put(channel, bytes, size, t_us);
}

bool LogWriter::flush() {
  if (!log_) return false;
  const bool written = !full_ && std::fflush(log_->f) == 0;
  if (written) {
    on_disk_ = written_;
    marked_on_disk_ = marked_;
    return true;
  }
  fail(files_.back() + ": the disk is full");
  // The log must end with a whole event: discards the buffer of stdio and a partial event.
  __fpurge(log_->f);
  if (ftruncate(fileno(log_->f), on_disk_) != 0)
    fmt::print(stderr, "{}: cannot be cut back to its last whole event\n", files_.back());
  return false;
}

}  // namespace twinrate
