// Exports a log to a file format of other tools.
//
// LCM log: one stream for each channel (mat, mcap) or one table (csv, tick_table.hpp). Drive log
// CSV: its canonical columns as the stream DRIVE_LOG. Memory does not grow with the length of the
// log, except for mat.
#pragma once
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/event_log.hpp"

namespace twinrate {

struct ExportRequest {
  std::string log;     // run directory, LCM log or drive log CSV
  std::string format;  // csv, mat, mcap
  std::string out;
  std::vector<Channel> channels;  // empty: csv the table alone, else all except ACK
  double from_s = -std::numeric_limits<double>::infinity();  // time of the log
  double to_s = std::numeric_limits<double>::infinity();
  double rate_Hz = 0;                // 0: as logged
  std::string compression = "zstd";  // of an mcap: zstd, lz4, none
  OnDamage on_damage = OnDamage::kRefuse;
};

struct ExportedStream {
  std::string name;
  std::int64_t samples = 0;
  double first_s = 0, last_s = 0;
};

struct Exported {
  std::vector<ExportedStream> streams;
  std::int64_t left_out = 0;  // ticks omitted from the table
  std::int64_t late = 0;      // messages that came too late for the row of their tick
  std::string damage;         // of the log, with OnDamage::kSkip; "" if it is whole
  bool interrupted = false;   // the file is valid up to the interruption
};

// `progress` gets the share read. If it throws Stopped (core/percent_line.hpp), the file ends
// there; Stopped is passed on if nothing was written yet. Throws BadInput: no such log, none of the
// channels, no message between from and to.
Exported export_log(const ExportRequest& request, const std::function<void(double)>& progress);

// "MEASUREMENT,DRIVE_ESTIMATE" as channels. Throws BadInput.
std::vector<Channel> channels_of(const std::string& list);

}  // namespace twinrate
