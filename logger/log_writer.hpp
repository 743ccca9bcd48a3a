// Writes an LCM log that is readable after a full disk.
//
// Marks show that a part begins and ends (core/log_marks.hpp); the log of a full disk does not end.
// Whole events are collected and written `gather_bytes` at a time. Every write is checked. If the
// disk is full, the log is truncated to a mark on the disk (without one to its last whole event),
// so that up to 64 kB remain for the results of the run, and the writer accepts no more events:
// marked_on_disk() gives the kept ticks. An existing file is not overwritten. At `rotate_bytes` the
// next file is started: log.lcm, log-001.lcm, .. each with the manifest first.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace twinrate {

class LogWriter {
 public:
  // Throws BadInput if the first file exists, std::runtime_error if it cannot be created.
  // `first_part`: number of existing parts. `gather_bytes`: a killed process loses this much; a
  // write of 1 MB costs the kernel half of sixteen writes of 64 kB.
  LogWriter(std::string directory, std::int64_t rotate_bytes, std::size_t first_part = 0,
            std::size_t gather_bytes = 65536);
  ~LogWriter();
  LogWriter(const LogWriter&) = delete;
  LogWriter& operator=(const LogWriter&) = delete;

  // Event written at the start of this file and of every later one.
  void set_manifest(const std::string& channel, const std::vector<std::uint8_t>& bytes,
                    std::int64_t t_us);
  // False once the disk is full, or if the next file exists.
  bool write(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
             std::int64_t t_us);
  // The address of a message of `size` bytes in the next event: the caller encodes there, before
  // any other call. Null if write() would return false.
  std::uint8_t* room_for(const std::string& channel, std::size_t size, std::int64_t t_us);
  // Flushes all events to the file; false once the disk is full.
  bool flush();
  // As flush(), with the mark that the log ends; the last thing to be written.
  bool finish();
  bool full() const { return full_; }
  // Why the writer accepts no more events; "" while it does.
  const std::string& failure() const { return failure_; }
  // The events written so far belong to the ticks below k; in realtime, to those that arrived.
  void mark(std::int64_t k) {
    marks_.push_back({k, files_.size() - 1, on_disk_ + static_cast<std::int64_t>(gathered_)});
  }
  // The last mark whose events are all in the files.
  std::int64_t marked_on_disk() const { return marked_on_disk_.k; }
  const std::vector<std::string>& files() const { return files_; }
  // True once after a new file was started.
  bool take_rotated() { return std::exchange(rotated_, false); }

 private:
  void open_next();  // throws as the constructor
  void close();
  void begin_part(std::int64_t t_us);  // with its manifest and mark, if there is a manifest
  void put_mark(std::string_view text, std::int64_t t_us);
  void cut_to_mark();
  void fail(const std::string& why);
  bool next_part_if_due(std::int64_t t_us);
  std::uint8_t* append(const std::string& channel, std::size_t size, std::int64_t t_us);
  bool put(const std::string& channel, const std::uint8_t* bytes, std::size_t size,
           std::int64_t t_us);

  std::string directory_;
  std::int64_t rotate_bytes_;
  std::size_t first_part_, gather_bytes_;
  int file_ = -1;
  std::vector<std::uint8_t> buffer_;
  std::size_t gathered_ = 0;         // bytes at its begin: events to be written
  std::int64_t on_disk_ = 0;         // bytes of whole events in the present file
  std::int64_t events_ = 0;          // of the present file
  std::int64_t manifest_bytes_ = 0;  // with its mark, of the present file, if it is a later one
  std::int64_t t_us_ = 0;            // of the last event
  struct Mark {
    std::int64_t k = 0;
    std::size_t file = 0;     // of files_
    std::int64_t bytes = -1;  // of that file; -1: there was no mark
  } marked_on_disk_;
  std::vector<Mark> marks_;  // since the last flush
  std::vector<std::string> files_;
  std::string manifest_channel_;
  std::vector<std::uint8_t> manifest_;
  bool full_ = false, rotated_ = false, finished_ = false;
  std::string failure_;
};

}  // namespace twinrate
