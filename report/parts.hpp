// The parts of a page, as JSON for report.js. A section is {heading, note, columns, figures} and
// may have a table {head, rows} under its figures.
#pragma once
#include <vector>

#include "report/figure.hpp"
#include "report/report.hpp"

namespace twinrate::report {

// A run with its log read across, as every part wants it.
struct RunView {
  const ReportRun& run;
  AngleReference reference;
  std::vector<TickRow> rows;

  RunView(const ReportRun& r, AngleReference wanted)
      : run(r), reference(resolve(wanted, r.log)), rows(tick_rows(r.log)) {}
  int n_p() const { return run.config.machine.n_p; }
  // Not locked, and not merely by the speed of a drive that has a position sensor.
  bool lost() const { return run.summary.locked && !*run.summary.locked && !only_left_reference(); }
  // Not locked by a speed ripple, while the angle is the sensor's.
  bool only_left_reference() const {
    return run.summary.lost_why == kLeftReference && !run.log.estimate.empty() &&
           (run.log.estimate.back().status & kMeasuredAngle);
  }
  bool has_P44() const { return run.config.estimator.kind == "ekf_sensorless"; }
  // "the true" or "the measured", of the angle errors are taken from.
  std::string reference_word() const {
    return reference == AngleReference::kEncoder ? "measured" : "true";
  }
  double begin_s() const { return rows.empty() ? 0 : rows.front().t_s; }
  double end_s() const { return rows.empty() ? 0 : rows.back().t_s; }
  double settled_s() const { return begin_s() + run.config.run.settle_s; }
  // True speed, or the estimate where there is no truth; NaN where there is neither.
  double omega_m(const TickRow& row) const;
  // Rows of [from_s, to_s].
  std::vector<TickRow> between(double from_s, double to_s) const;
  // About four electrical turns at the end of the run.
  std::vector<TickRow> short_window() const;
};

// page.cpp: the page with everything it needs inside; replaces `out_path` whole. Throws
// std::runtime_error where it cannot be written or the page's own assets are not found.
void write_page(Json page, const std::string& title, const std::string& out_path);

// words.cpp
std::string frequency(double f_Hz);
std::string degrees(const std::optional<double>& angle_rad);  // "2.51", or "-" where empty
std::string rates(const DriveConfig& config);                 // f_s, f_b, n, policy
Json verdict(const RunView& view);                            // {state, headline, text}
Json summary_table(const RunView& view);                      // [[quantity, value], ..]
Json event_table(const RunLog& log);                          // [[t, process, reason, text], ..]

// ripple_page.cpp: load torque and speed ripple over the angle of the rotor.
std::vector<Json> ripple_sections(const RunView& view);
// ripple_comparison.cpp: the same of several runs. `names` as in the other sections.
Json shape_section(const std::vector<RunView>& views, const std::vector<std::string>& names);
Json reduction_section(const std::vector<RunView>& views, const std::vector<std::string>& names);

// run_page.cpp: the sections of one run. loss.cpp: the one about losing synchronism.
Json run_sections(const RunView& view);
Json loss_section(const RunView& view);
Figure angles_figure(const RunView& view, const std::vector<TickRow>& rows);
Figure error_figure(const RunView& view, const std::vector<TickRow>& rows);
Figure speed_figure(const RunView& view, const std::vector<TickRow>& rows);

// comparison.cpp: {table, sections} of several runs.
Json comparison_table(const std::vector<RunView>& views);
Json comparison_sections(const std::vector<RunView>& views);

}  // namespace twinrate::report
