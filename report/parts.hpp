// The parts of a page, as JSON for report.js. A section is {heading, note, columns, figures},
// optionally with a table {head, rows} under its figures.
#pragma once
#include <algorithm>
#include <vector>

#include "report/figure.hpp"
#include "report/report.hpp"

namespace twinrate::report {

// A run and its table of ticks.
struct RunView {
  const ReportRun& run;
  AngleReference reference;
  TickRows rows;

  RunView(const ReportRun& r, AngleReference wanted)
      : run(r), reference(r.ticks.outline.resolve(wanted)), rows(r.ticks.rows) {}
  bool has_truth() const { return run.ticks.outline.has_truth(); }
  int n_p() const { return run.config.machine.n_p; }
  // Synchronism lost or the drive tripped.
  bool lost() const { return run.summary.locked == false && run.summary.lost_at_s; }
  bool has_P44() const { return run.config.estimator.kind == "ekf_sensorless"; }
  // Word for the reference of the angle errors.
  std::string reference_word() const {
    return reference == AngleReference::kEncoder ? "measured" : "true";
  }
  double begin_s() const { return rows.empty() ? 0 : rows.front().t_s; }
  double end_s() const { return rows.empty() ? 0 : rows.back().t_s; }
  double settled_s() const {
    return begin_s() + std::max(run.config.run.settle_s, run.summary.window_from_s);
  }
  // True speed, else the estimate, else NaN.
  double omega_m(const TickRow& row) const;
  // Rows from the first one at from_s or later to the last one at to_s or earlier.
  TickRows between(double from_s, double to_s) const;
  // About four electrical turns at the end of the run.
  TickRows short_window() const;
};

// page.cpp: writes the page and its assets into one file. Throws std::runtime_error if it cannot be
// written or an asset is missing.
void write_page(Json page, const std::string& title, const std::string& out_path);

// words.cpp
std::string frequency(double f_Hz);
std::string degrees(const std::optional<double>& angle_rad);  // "2.51"; "-" if empty
std::string rates(const RunView& view);                       // f_s, f_b, n, policy
Json verdict(const RunView& view);                            // {state, headline, text}
Json summary_table(const RunView& view);                      // [[quantity, value], ..]
Json event_table(const RunLog& log);                          // [[t, process, reason, text], ..]

// transport.cpp: latency of each hop and links to other hosts, [[quantity, value], ..].
Json transport_rows(const std::string& manifest_json);
std::string command_of(const std::string& manifest_json);  // "" if none was recorded

// ripple_page.cpp: load torque and speed ripple over the angle of the rotor.
std::vector<Json> ripple_sections(const RunView& view);
// ripple_comparison.cpp: the same of several runs. `names` as in the other sections.
Json shape_section(const std::vector<RunView>& views, const std::vector<std::string>& names);
Json reduction_section(const std::vector<RunView>& views, const std::vector<std::string>& names);
// ripple_methods.cpp: the ripple of every compensation and filter at every speed, on one scale.
Json methods_section(const std::vector<RunView>& views);

// step_comparison.cpp: runs over time with their steps, and the keys that differ.
Json steps_section(const std::vector<RunView>& views, const std::vector<std::string>& names);
Json difference_section(const std::vector<RunView>& views, const std::vector<std::string>& names);

// run_page.cpp: the sections of one run. loss.cpp: the section on the loss of synchronism.
Json run_sections(const RunView& view);
Json loss_section(const RunView& view);
// True current along d (0) or q (1), else the measured one turned by the reference angle.
Quantity current(const RunView& view, int axis);
Figure angles_figure(const RunView& view, TickRows rows);
Figure error_figure(const RunView& view, TickRows rows, std::size_t max_points = kMaxPoints);
Figure speed_figure(const RunView& view, TickRows rows, std::size_t max_points = kMaxPoints);

// transient_page.cpp: start and load steps of a salient machine.
std::vector<Json> transient_sections(const RunView& view);

// comparison.cpp: {table, sections} of several runs.
Json comparison_table(const std::vector<RunView>& views);
Json comparison_sections(const std::vector<RunView>& views);

}  // namespace twinrate::report
