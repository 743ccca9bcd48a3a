// Runs the searches of one shard on all cores and writes the result.
#pragma once
#include <string>

#include "core/result_directory.hpp"
#include "sweep/result.hpp"

namespace twinrate::sweep {

struct RunOptions {
  bool resume = false;
  bool json = false;
};

// Begins the result in the directory of this shard. Appends to points.csv until all searches are
// complete or the user stops the sweep. Returns true if stopped. Throws BadInput if --resume finds
// another sweep.
bool run_searches(const Plan& plan, const Config& config, ResultDirectory& directory,
                  const RunOptions& options);
// Writes points.csv in order, fbmin.csv, figure.svg and why.csv; prints the table.
void write_result(const Plan& plan, const Config& config, const std::string& directory,
                  std::vector<Point> points, bool json);

}  // namespace twinrate::sweep
