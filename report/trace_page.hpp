// The page of `twinrate trace`: what the model lacks, and the pictures by which a drive engineer
// checks the claim. One self-contained HTML file, like the report of a run (report.hpp).
//
//   verdict; effects with parameters and evidence; errors before and after; each effect over the
//   data that shows it; residuals over time, angle and as spectra; unexplained structure; what
//   was considered, what cannot be told, data health; the extended drive file
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

// Throws std::runtime_error where the page cannot be written or its assets are not found.
void write_trace_page(const TraceResult& result, const TracePage& page,
                      const std::string& out_path);

}  // namespace twinrate
