// Writes an LCM log that stays readable after a crash or on a full disk.
//
// Events go through liblcm's event log; every flush() is checked. Where the disk is full the file
// is cut back to the last whole event that reached it, and the writer refuses to go on. At
// `rotate_bytes` the next file is begun: log.lcm, log-001.lcm, .. each with the manifest first.
#pragma once
#include <lcm/eventlog.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace twinrate {

class LogWriter {
 public:
  // Throws std::runtime_error where the first file cannot be created.
  LogWriter(std::string directory, std::int64_t rotate_bytes);
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  // Event written at the head of this file and of every later one.
  void set_manifest(const std::string& channel, const std::vector<std::uint8_t>& bytes,
                    std::int64_t t_us);
  // False once the disk is full.
  bool write(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
             std::int64_t t_us);
  // Everything written so far is in the file; false once the disk is full.
  bool flush();
  bool full() const { return full_; }
  const std::vector<std::string>& files() const { return files_; }
  // True once, after a new file was begun.
  bool take_rotated() { return std::exchange(rotated_, false); }

 private:
  void open_next();
  void close();
  bool put(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
           std::int64_t t_us);

  std::string directory_;
  std::int64_t rotate_bytes_;
  lcm_eventlog_t* log_ = nullptr;
  std::int64_t written_ = 0;  // bytes handed to the present file
  std::int64_t on_disk_ = 0;  // whole events known to be in it, at most kFlushBytes behind
  static constexpr std::int64_t kFlushBytes = 65536;
  std::vector<std::string> files_;
  std::string manifest_channel_;
  std::vector<std::uint8_t> manifest_;
  bool full_ = false, rotated_ = false;
};

}  // namespace twinrate
