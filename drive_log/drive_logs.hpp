// Full drive logs, one after the other in one record that fits into memory.
//
// Every row of every file is read once: health, and of each slot of rows its place in the file and
// means (trace/blocks.hpp). Where all rows together need more memory than is allowed, each file
// gets an equal share of what is, less where it needs less, and of the longer ones blocks spread
// over their length are read again. Rows not in a block are not used. Time stays the log's own.
#pragma once
#include <functional>
#include <string>
#include <vector>

#include "core/drive_config.hpp"
#include "trace/health.hpp"

namespace twinrate {

struct LogRequest {
  std::vector<std::string> data, held_out;  // files
  std::vector<std::string> maps = {};
  bool repair = false;
  double memory_MiB = 1024;  // that the trace may take
};

// A file, and the rows of the record that are its.
struct DriveLog {
  std::string path;
  bool held_out = false;
  Health health;
  std::size_t first = 0, end = 0;
  double later_s = 0;  // by which the record's time is ahead of the file's (Record::append)
};

struct DriveLogs {
  Record record;
  std::vector<DriveLog> files;
  Health health;
  std::vector<std::string> notes;  // one line each
  // Rows of one file between two times of the record, whether traced or not. Throws BadInput.
  std::function<Record(std::size_t file, double begin_s, double end_s)> stretch;
  // Of each row of the record: whether its file is held out.
  std::vector<char> held_out() const;
};

// Share read of what; may throw.
using Reading = std::function<void(const std::string& what, double share)>;

// Rows of a log with that sampling interval which the tracer can hold in so much memory.
std::size_t rows_within(double memory_MiB, double T_s);

// Throws BadInput.
DriveLogs read_drive_logs(const LogRequest& asked, const DriveConfig& drive,
                          const Reading& reading = {});

}  // namespace twinrate
