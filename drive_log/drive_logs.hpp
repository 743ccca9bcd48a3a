// Reads full drive logs into one record of limited memory.
//
// The first pass reads every row of every file: data health, and the means and the place of each
// slot of rows (trace/blocks.hpp). If the rows exceed the allowed memory, each file gets an equal
// share of it; a short file passes the unused part of its share to the others. Of a file longer
// than its share, blocks spread over its length are read again and the other rows are not used.
// Times are those of the log.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "core/drive_config.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"

namespace twinrate {

struct LogRequest {
  std::vector<std::string> data, held_out;  // files
  std::vector<std::string> maps = {};
  bool repair = false;
  double memory_MiB = 1024;  // limit of the whole trace
};

// A file and its rows [first, end) in the record.
struct DriveLog {
  std::string path;
  bool held_out = false;
  Health health;
  std::size_t first = 0, end = 0;
  double time_offset_s = 0;  // time in the record less time in the file (Record::append)
  // With the drive file. Empty for a file that is alone: the trace itself checks its record.
  std::vector<Inconsistency> inconsistent = {};
};

struct DriveLogs {
  Record record;
  std::vector<DriveLog> files;
  Health health;
  std::vector<std::string> notes;   // one line each
  std::vector<std::string> damage;  // of LCM logs that are not whole, one line each
  // Rows of one file between two times of the record, in a block or not. Throws BadInput.
  std::function<Record(std::size_t file, double begin_s, double end_s)> stretch;
  // For each row of the record: 1 if its file is held out.
  std::vector<char> held_out() const;
};

// Receives the share read of `what`; may throw.
using ReadProgress = std::function<void(const std::string& what, double share)>;

// Number of rows with sampling interval T_s that the tracer can hold in memory.
std::size_t rows_within(double memory_MiB, double T_s);

// Throws BadInput.
DriveLogs read_drive_logs(const LogRequest& asked, const DriveConfig& drive,
                          const ReadProgress& progress = {});

}  // namespace twinrate
