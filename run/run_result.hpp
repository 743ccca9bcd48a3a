// What every run leaves behind: the run directory and one clear table.
#pragma once
#include <string>

#include "analysis/summary.hpp"
#include "core/config.hpp"

namespace twinrate {

// Facts the log does not hold.
struct RunFacts {
  double wall_s = 0;
  std::int64_t repeats = 0, deadline_misses = 0, late_gains = 0, late_commands = 0;
  std::string how;          // "launch, lock-step, 5 processes" or "simulate"
  std::string ended;        // "" for a run to its end, otherwise what stopped it
  std::string not_written;  // files that could not be written, for the table
};

// Creates DIR (default runs/NAME-DATE-TIME) and writes config.toml; returns its path.
std::string make_run_directory(const std::string& wanted, const Config& config);
// Reads DIR/log.lcm, writes summary.json, manifest.json and report.html, prints the table. Files
// that cannot be written (the disk is full) are named in the table. Returns the exit code: 0, or 1
// where the drive lost synchronism, messages were lost, or the run ended early by itself.
int conclude_run(const std::string& directory, const Config& config, RunFacts facts);

}  // namespace twinrate
