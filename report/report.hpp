// Writes one self-contained HTML page of figures for a run or a comparison of runs. The page needs
// no network: chart code, style and numbers are in the file.
//
//   one run       verdict in words, table, loss of synchronism (Dilys 2021, Fig. 11), whole run,
//                 a short window of about four electrical turns (Figs 4, 5, 8, 9), load torque and
//                 its orders, events, config
//   several runs  table of n, f_b, errors and P44; speed, currents and torque overlaid, with the
//                 figures of each step (analysis/step_response.hpp); angle errors side by side
//                 (Fig. 10); P44 and gains overlaid; the keys that differ between the drive files
//
// A figure is omitted if the log does not hold its quantities. Degrees are for display only.
#pragma once
#include <stdexcept>
#include <string>
#include <vector>

#include "analysis/run_ticks.hpp"

namespace twinrate {

// A run to report. All of it must exist during the call.
struct ReportRun {
  const RunLog& log;  // path, events and drive file
  const RunTicks& ticks;
  const DriveConfig& config;
  const Summary& summary;
  std::string manifest_json =
      {};  // of the run directory: latencies, links; empty where there is none
};

struct ReportOptions {
  std::string title;  // empty: the drive's name
  AngleReference angle_reference = AngleReference::kAuto;
  std::vector<std::string> notes = {};  // lines under the heading
};

// Writes or replaces `out_path`. Throws std::runtime_error if it cannot be written or the page's
// assets are missing, BadInput without runs.
void write_report(const std::vector<ReportRun>& runs, const ReportOptions& options,
                  const std::string& out_path);

}  // namespace twinrate
