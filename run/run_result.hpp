// The result of a run: its directory and the table on the terminal.
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "analysis/long_log.hpp"
#include "core/config.hpp"
#include "core/result_directory.hpp"
#include "run/links.hpp"

namespace twinrate {

// Facts of a run that are not in its log.
struct RunFacts {
  double wall_s = 0;
  std::int64_t repeats = 0, deadline_misses = 0, late_gains = 0, late_commands = 0, refused = 0;
  bool tags_checked = true;        // bus.authenticate, where there is a bus
  bool realtime = false;           // the log has host times worth a figure
  bool on_bus = false;             // messages can be lost
  std::string scheduling;          // realtime: what the machine granted
  std::string how;                 // "launch, lock-step, 5 processes" or "simulate"
  std::string ended;               // cause of an early end; "" for a complete run
  std::string not_written;         // names of files that could not be written
  bool quiet = false;              // no table on the terminal
  std::optional<LongLog> kept;     // log and ticks, where the run kept them in memory
  std::vector<LinkFigures> links;  // to the processes that launch did not start
};

// Begins a run in DIR (default runs/NAME-DATE-TIME) and writes config.toml. `force`: replaces the
// run that DIR holds. Throws BadInput as ResultDirectory.
std::unique_ptr<ResultDirectory> make_run_directory(const std::string& wanted, const Config& config,
                                                    bool force);
// Reads DIR/log.lcm if the run did not keep its log, writes summary.json, manifest.json and report.html, prints the table. The
// table names the files that could not be written (disk full). Returns the exit code: 1 if
// the drive tripped, synchronism or messages were lost, the estimate never took over, the run ended
// early or a file could not be written; else 0.
int conclude_run(const std::string& directory, const Config& config, RunFacts facts);

}  // namespace twinrate
