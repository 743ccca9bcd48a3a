// One self-contained HTML page of figures for a run, or a comparison of several. It opens from
// file:// without a network: chart code, style and numbers are all inside.
//
//   one run       verdict in words, table, the loss if there is one (Dilys 2021, Fig. 11), whole
//                 run, a short window of about four electrical turns (Figs 4, 5, 8, 9), load torque
//                 and its orders, events, config
//   several runs  table of n, f_b, errors and P44; angle errors side by side (Fig. 10); P44 and
//                 gains overlaid
//
// Figures whose quantities a log does not hold are left out. Degrees are for display only.
#pragma once
#include <stdexcept>
#include <string>
#include <vector>

#include "analysis/summary.hpp"

namespace twinrate {

// What a page is made of; the log must outlive the call.
struct ReportRun {
  const RunLog& log;
  const DriveConfig& config;
  const Summary& summary;
};

struct ReportOptions {
  std::string title;  // empty: the drive's name
  AngleReference angle_reference = AngleReference::kAuto;
};

// Writes the page to `out_path`, replacing it whole. Throws std::runtime_error where it cannot be
// written or the page's own assets are not found, BadInput where no run is given.
void write_report(const std::vector<ReportRun>& runs, const ReportOptions& options,
                  const std::string& out_path);

}  // namespace twinrate
