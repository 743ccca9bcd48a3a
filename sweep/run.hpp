// Runs the searches of one shard on every core, and writes what came out.
#pragma once
#include <string>

#include "sweep/result.hpp"

namespace twinrate::sweep {

struct RunOptions {
  std::string directory;  // of this shard
  bool resume = false;
  bool json = false;
};

// Appends to points.csv until every search is done or the user stops it. Returns whether it was
// stopped. Throws BadInput where --resume finds another sweep.
bool run_searches(const Plan& plan, const Config& config, const RunOptions& options);
// points.csv in order, fbmin.csv, figure.svg, why.csv, and the printed table.
void write_result(const Plan& plan, const Config& config, const std::string& directory,
                  std::vector<Point> points, bool json);

}  // namespace twinrate::sweep
