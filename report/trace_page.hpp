// The page of `twinrate trace`: the effects missing in the model, and the pictures with which a
// drive engineer checks the claim. One self-contained HTML file, like the report of a run
// (report.hpp).
//
//   verdict; effects with parameters and evidence; errors before and after; each effect over the
//   data that shows it; residuals over time, angle and as spectra; unexplained structure;
//   candidates, aliases and effects that are not identifiable, data health; extended drive file
#pragma once
#include <string>

#include "trace/result.hpp"

namespace twinrate {

struct TracePage {
  std::string drive;          // name of the declared model
  std::string extended_toml;  // the drive file with the effects added
  int n_p = 1;
  std::string revision;
};

// Throws std::runtime_error if the page cannot be written or its assets are missing.
void write_trace_page(const TraceResult& result, const TracePage& page,
                      const std::string& out_path);

}  // namespace twinrate
