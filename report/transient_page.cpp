// Start and load steps of a salient machine: angle, speed, torque, and the currents as a locus.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "report/parts.hpp"

namespace twinrate::report {
namespace {

constexpr double kBefore_s = 0.05, kAfter_s = 0.25;  // around a load step

Figure torque_figure(TickRows rows) {
  Figure figure{.title = "Torque", .x_label = "t (s)", .y_label = "torque (Nm)"};
  const auto T_em = [](const TickRow& row) {
    return row.truth ? row.truth->T_em : std::numeric_limits<double>::quiet_NaN();
  };
  figure.draw(rows, {{"T_em", "true", T_em}, {"T_load", "ref", quantity::T_load_true}});
  return figure;
}

// Points over i_q: a curve over time would cross itself. Values: i_q, i_d, i_d_ref of each tick.
Figure locus_figure(TickRows rows) {
  std::vector<const TickRow*> by_i_q;
  for (const TickRow& row : rows)
    if (row.truth && row.command && std::isfinite(row.truth->i_dq[1])) by_i_q.push_back(&row);
  std::sort(by_i_q.begin(), by_i_q.end(), [](const TickRow* a, const TickRow* b) {
    return a->truth->i_dq[1] < b->truth->i_dq[1];
  });
  Figure figure{.title = "Locus of the current", .x_label = "i_q (A)", .y_label = "i_d (A)"};
  std::vector<double> i_d, i_d_ref;
  for (const TickRow* row : by_i_q) {
    figure.x.push_back(row->truth->i_dq[1]);
    i_d.push_back(row->truth->i_dq[0]);
    i_d_ref.push_back(row->command->i_dq_ref[0]);
  }
  figure.add({"i_d", "dots", i_d});
  figure.add({"i_d_ref", "dots2", i_d_ref});
  figure.note = "One point a tick, against the i_q of the same tick.";
  return figure;
}

Json section(const RunView& view, const std::string& heading, double from_s, double to_s) {
  const TickRows rows = view.between(from_s, to_s);
  Json figures = Json::array();
  for (Figure figure : {angles_figure(view, rows), speed_figure(view, rows), torque_figure(rows),
                        locus_figure(rows)}) {
    if (figure.empty()) continue;
    if (figure.x_label == "t (s)") figure.group = heading;
    figures.push_back(to_json(figure));
  }
  return {{"heading", heading}, {"note", ""}, {"columns", 2}, {"figures", figures}};
}

}  // namespace

std::vector<Json> transient_sections(const RunView& view) {
  const MachineParameters& m = view.run.config.machine;
  if (m.L_d == m.L_q || view.rows.empty()) return {};
  std::vector<Json> sections = {section(view, "Start", view.begin_s(), view.settled_s())};
  for (const ProfileStep& step : view.run.config.load.T_load_Nm.steps())
    if (step.t_s > 0 && view.begin_s() + step.t_s < view.end_s())
      sections.push_back(
          section(view, fmt::format("Load to {:.4g} Nm at {:.4g} s", step.value, step.t_s),
                  view.begin_s() + step.t_s - kBefore_s, view.begin_s() + step.t_s + kAfter_s));
  return sections;
}

}  // namespace twinrate::report
