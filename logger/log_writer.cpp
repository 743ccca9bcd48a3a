#include "logger/log_writer.hpp"

#include <endian.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "core/log_marks.hpp"
#include "core/output_file.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kLargestUsual = 65536;     // event: a larger one makes the buffer grow
constexpr std::int64_t kLeftOnFullDisk = 65536;  // for the results of the run

// The event log of liblcm: numbers in network order, then the channel and the message.
struct EventHeader {
  std::uint32_t sync = htobe32(0xEDA1DA01);
  std::uint64_t number = 0, t_us = 0;
  std::uint32_t channel_bytes = 0, message_bytes = 0;
} __attribute__((packed));

// The number of bytes written: fewer if the disk is full.
std::size_t write_all(int file, const std::uint8_t* bytes, std::size_t size) {
  std::size_t done = 0;
  while (done < size) {
    const ssize_t written = ::write(file, bytes + done, size - done);
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) break;
    done += static_cast<std::size_t>(written);
  }
  return done;
}

}  // namespace

LogWriter::LogWriter(std::string directory, std::int64_t rotate_bytes, std::size_t first_part,
                     std::size_t gather_bytes)
    : directory_(std::move(directory)),
      rotate_bytes_(rotate_bytes),
      first_part_(first_part),
      gather_bytes_(gather_bytes) {
  std::error_code refused;  // open_next() then fails, too
  std::filesystem::create_directories(directory_, refused);
  open_next();
}

LogWriter::~LogWriter() {
  finish();
  close();
}

bool LogWriter::finish() {
  if (!finished_ && !manifest_.empty()) put_mark(kLogEnds, t_us_);
  finished_ = true;
  return flush();
}

void LogWriter::open_next() {
  const std::size_t part = first_part_ + files_.size();
  const std::string name = part == 0 ? "log.lcm" : fmt::format("log-{:03}.lcm", part);
  const std::string path = (std::filesystem::path(directory_) / name).string();
  create_new(path);
  file_ = ::open(path.c_str(), O_WRONLY | O_CLOEXEC);
  if (file_ < 0)
    throw std::runtime_error(fmt::format("{}: cannot be written: {}", path, std::strerror(errno)));
  files_.push_back(path);
  buffer_.resize(gather_bytes_ + kLargestUsual);
  on_disk_ = events_ = 0;
}

void LogWriter::fail(const std::string& why) {
  full_ = true;
  if (failure_.empty()) failure_ = why;
}

void LogWriter::close() {
  if (file_ >= 0) ::close(file_);
  file_ = -1;
}

void LogWriter::set_manifest(const std::string& channel, const std::vector<std::uint8_t>& bytes,
                             std::int64_t t_us) {
  manifest_channel_ = channel;
  manifest_ = bytes;
  begin_part(t_us);
  mark(0);  // a full disk within the first tick keeps no part of it
}

void LogWriter::begin_part(std::int64_t t_us) {
  if (manifest_.empty()) return;
  put(manifest_channel_, manifest_.data(), manifest_.size(), t_us);
  put_mark(first_part_ > 0 && files_.size() == 1 ? kLogGoesOn : kLogBegins, t_us);
}

void LogWriter::put_mark(std::string_view text, std::int64_t t_us) {
  put(std::string(kLogMarkChannel), reinterpret_cast<const std::uint8_t*>(text.data()), text.size(),
      t_us);
}

// Header and channel of an event; the place of its message.
std::uint8_t* LogWriter::append(const std::string& channel, std::size_t size, std::int64_t t_us) {
  if (full_ || (gathered_ >= gather_bytes_ && !flush())) return nullptr;
  t_us_ = t_us;
  const EventHeader header{.number = htobe64(static_cast<std::uint64_t>(events_++)),
                           .t_us = htobe64(static_cast<std::uint64_t>(t_us)),
                           .channel_bytes = htobe32(static_cast<std::uint32_t>(channel.size())),
                           .message_bytes = htobe32(static_cast<std::uint32_t>(size))};
  const std::size_t event_bytes = sizeof header + channel.size() + size;
  if (buffer_.size() < gathered_ + event_bytes) buffer_.resize(gathered_ + event_bytes);
  std::uint8_t* const event = buffer_.data() + gathered_;
  std::memcpy(event, &header, sizeof header);
  std::memcpy(event + sizeof header, channel.data(), channel.size());
  gathered_ += event_bytes;
  return event + sizeof header + channel.size();
}

bool LogWriter::put(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
                    std::int64_t t_us) {
  std::uint8_t* const message = append(channel, size, t_us);
  if (!message) return false;
  if (size > 0) std::memcpy(message, bytes, size);
  return gathered_ < gather_bytes_ || flush();
}

std::uint8_t* LogWriter::room_for(const std::string& channel, std::size_t size, std::int64_t t_us) {
  return next_part_if_due(t_us) ? append(channel, size, t_us) : nullptr;
}

bool LogWriter::next_part_if_due(std::int64_t t_us) {
  if (on_disk_ + static_cast<std::int64_t>(gathered_) <= rotate_bytes_) return true;
  if (!manifest_.empty()) put_mark(kLogContinues, t_us_);
  if (!flush()) return false;
  close();
  try {
    open_next();
  } catch (const std::runtime_error& refused) {
    fail(refused.what());
    cut_to_mark();
    return false;
  }
  rotated_ = true;
  begin_part(t_us);
  manifest_bytes_ = static_cast<std::int64_t>(gathered_);
  return true;
}

bool LogWriter::write(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
                      std::int64_t t_us) {
  return next_part_if_due(t_us) && put(channel, bytes, size, t_us);
}

bool LogWriter::flush() {
  if (file_ < 0 || full_) return false;
  const std::size_t written = write_all(file_, buffer_.data(), gathered_);
  const std::int64_t end = on_disk_ + static_cast<std::int64_t>(written);
  const bool all = written == gathered_;
  for (const Mark& mark : marks_)
    if (mark.bytes <= (all ? end : end - kLeftOnFullDisk)) marked_on_disk_ = mark;
  marks_.clear();
  if (all) {
    on_disk_ = end;
    gathered_ = 0;
    return true;
  }
  fail(files_.back() + ": the disk is full");
  cut_to_mark();
  return false;
}

// Removes the remainder of a partial write and the messages of an incomplete tick. They may have
// begun in the file before this one; this file then keeps only its manifest.
void LogWriter::cut_to_mark() {
  const Mark& mark = marked_on_disk_;
  const std::size_t last = files_.size() - 1;
  const auto cut = [](const std::string& path, std::int64_t bytes) {
    if (truncate(path.c_str(), bytes) != 0)
      fmt::print(stderr, "{}: cannot be cut back to its last whole tick\n", path);
  };
  if (mark.bytes < 0) return cut(files_.back(), on_disk_);
  if (mark.file == last) return cut(files_.back(), mark.bytes);
  cut(files_[mark.file], mark.bytes);
  cut(files_.back(), std::min(on_disk_, manifest_bytes_));
}

}  // namespace twinrate
