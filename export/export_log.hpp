// A log as a file that other tools read.
//
// An LCM log gives a stream a channel (mat, mcap) or one table (csv, tick_table.hpp); a drive log
// CSV gives its canonical columns as the one stream DRIVE_LOG. A log of any length passes through
// in little memory, but for mat.
#pragma once
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

struct ExportRequest {
  std::string log;     // run directory, LCM log or drive log CSV
  std::string format;  // csv, mat, mcap
  std::string out;
  std::vector<Channel> channels;  // empty: csv none beside the table, else all but ACK
  double from_s = -std::numeric_limits<double>::infinity();  // on the log's time
  double to_s = std::numeric_limits<double>::infinity();
  double rate_Hz = 0;  // 0: as logged
};

struct ExportedStream {
  std::string name;
  std::int64_t samples = 0;
  double first_s = 0, last_s = 0;
};

struct Exported {
  std::vector<ExportedStream> streams;
  std::int64_t left_out = 0;  // ticks of a table
  bool interrupted = false;   // the file holds what came before
};

// `progress`: share read, now and then; where it throws Stopped (core/percent_line.hpp) the file
// is ended there; Stopped comes out where nothing was written yet. Throws BadInput: no such log,
// none of those channels, nothing between from and to.
Exported export_log(const ExportRequest& request, const std::function<void(double)>& progress);

// "MEASUREMENT,DRIVE_ESTIMATE" as channels. Throws BadInput.
std::vector<Channel> channels_of(const std::string& list);

}  // namespace twinrate
