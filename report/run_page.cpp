#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "report/parts.hpp"

namespace twinrate::report {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kTurnsShown = 4;

Figure current_figure(const RunView& view) {
  Figure figure{.title = "Currents", .x_label = "t (s)", .y_label = "current (A)"};
  figure.group = "run";
  const std::string suffix = view.has_truth() ? "" : " measured";
  const char* names[] = {"i_d", "i_q"};
  std::vector<Curve> curves;
  for (const int axis : {1, 0}) {
    const std::string name = names[axis], set = axis == 1 ? "" : "2";
    curves.push_back({name + suffix, "true" + set, current(view, axis)});
    curves.push_back({name + "_hat", "hat" + set, [=](const TickRow& row) {
                        return row.estimate ? row.estimate->i_dq[axis] : kNaN;
                      }});
    curves.push_back({name + "_ref", "ref" + set, [=](const TickRow& row) {
                        return row.command ? row.command->i_dq_ref[axis] : kNaN;
                      }});
  }
  figure.draw(view.rows, curves);
  return figure;
}

Figure P44_figure(TickRows rows) {
  Figure figure{.title = "Angle variance", .x_label = "t (s)", .y_label = "P44 (rad²)"};
  figure.draw(rows, {{"P44", "hat", quantity::P44, true}});
  return figure;
}

Figure gain_figure(TickRows rows) {
  Figure figure{.title = "Gains on the angle", .x_label = "t (s)", .y_label = "K (rad/A)"};
  figure.draw(rows, {{"K41", "hat", quantity::K41, true}, {"K42", "hat2", quantity::K42, true}});
  return figure;
}

void push(Json& figures, Figure figure, const std::string& group, const std::string& letter = "") {
  if (figure.empty()) return;
  figure.group = group;
  if (!letter.empty()) figure.title = "(" + letter + ") " + figure.title;
  figures.push_back(to_json(figure));
}

Json whole_run_section(const RunView& view) {
  Json figures = Json::array();
  // The loss section shows the speed of a lost run.
  if (!view.lost()) push(figures, speed_figure(view, view.rows), "run");
  push(figures, error_figure(view, view.rows), "run");
  push(figures, current_figure(view), "run");
  if (view.has_P44()) {
    push(figures, P44_figure(view.rows), "run");
    push(figures, gain_figure(view.rows), "run");
  }
  return {{"heading", "Whole run"},
          {"note", "Drag to zoom all of them, double-click to come back."},
          {"columns", 1},
          {"figures", std::move(figures)}};
}

Json window_section(const RunView& view) {
  const TickRows rows = view.short_window();
  Json figures = Json::array();
  push(figures, angles_figure(view, rows), "window", "a");
  push(figures, error_figure(view, rows), "window", "b");
  if (view.has_P44()) {
    push(figures, P44_figure(rows), "window", "c");
    push(figures, gain_figure(rows), "window", "d");
  }
  return {{"heading", fmt::format("The last turns at {}", rates(view))},
          {"note", "About four electrical turns, every tick; gains as the fast loop held them."},
          {"columns", 2},
          {"figures", std::move(figures)}};
}

}  // namespace

Quantity current(const RunView& view, int axis) {
  const AngleReference reference = view.reference;
  const int n_p = view.n_p();
  return [=](const TickRow& row) {
    if (row.truth) return row.truth->i_dq[axis];
    const double theta_e = theta_e_reference(row, reference, n_p);
    const auto& m = row.measurement;
    if (!m || std::isnan(theta_e) || !(m->signals & kPhaseCurrents)) return kNaN;
    if (axis == 0 && (m->signals & kQCurrentOnly)) return kNaN;
    return park(clarke(Vec3(m->i_abc)), theta_e)[axis];
  };
}

double RunView::omega_m(const TickRow& row) const {
  return row.truth ? row.truth->omega_m : quantity::omega_m_hat(row);
}

TickRows RunView::between(double from_s, double to_s) const {
  const auto first = std::partition_point(rows.begin(), rows.end(),
                                          [=](const TickRow& row) { return row.t_s < from_s; });
  const auto last = std::partition_point(rows.begin(), rows.end(),
                                         [=](const TickRow& row) { return row.t_s <= to_s; });
  return first < last ? TickRows(first, last) : TickRows();
}

TickRows RunView::short_window() const {
  const double T_s = run.config.T_s();
  const std::size_t tail = std::min<std::size_t>(rows.size(), 50);
  double sum = 0;
  int count = 0;
  for (std::size_t i = rows.size() - tail; i < rows.size(); ++i) {
    const double speed = std::abs(omega_m(rows[i]));
    if (std::isfinite(speed)) sum += speed, ++count;
  }
  const double omega_e = count > 0 ? n_p() * sum / count : 0;
  const double turns_s = omega_e > 0 ? kTurnsShown * kTwoPi / omega_e : 0.1;
  const double longest_s = std::max(end_s() - std::min(settled_s(), end_s() - 0.1), 20 * T_s);
  return between(end_s() - std::clamp(turns_s, 20 * T_s, longest_s), end_s());
}

Figure angles_figure(const RunView& view, TickRows rows) {
  const std::string word = view.reference_word();
  Figure figure{.title = "Rotor position, " + word + " and estimated",
                .x_label = "t (s)",
                .y_label = "electrical angle (deg)"};
  figure.draw(rows, {{"theta_e " + word, "true", quantity::theta_e_deg(view.reference, view.n_p())},
                     {"theta_e_hat", "hat", quantity::theta_e_hat_deg}});
  figure.y_range = {{0, 360}};
  return figure;
}

Figure error_figure(const RunView& view, TickRows rows, std::size_t max_points) {
  Figure figure{.title = "Angle error theta_e_hat - theta_e",
                .x_label = "t (s)",
                .y_label = "angle error (deg)"};
  figure.draw(rows, {{"angle error", "hat", quantity::angle_error_deg(view.reference, view.n_p())}},
              max_points);
  constexpr double kMinRange_deg = 0.01;  // a rounding error must not fill the figure
  const bool tiny =
      !figure.empty() &&
      std::all_of(figure.series.front().values.begin(), figure.series.front().values.end(),
                  [](double e) { return !(std::abs(e) > kMinRange_deg); });
  if (tiny) figure.y_range = {{-kMinRange_deg, kMinRange_deg}};
  return figure;
}

Figure speed_figure(const RunView& view, TickRows rows, std::size_t max_points) {
  Figure figure{.title = "Speed", .x_label = "t (s)", .y_label = "omega_m (rad/s)"};
  const bool has_truth = std::any_of(rows.begin(), rows.end(), [](const TickRow& row) {
    return std::isfinite(quantity::omega_m_true(row));
  });
  std::vector<Curve> curves;
  if (has_truth)
    curves.push_back({"omega_m", "true", quantity::omega_m_true});
  else if (!view.has_truth())
    figure.add({"omega_m measured (slope over 10 ms)", "true",
                thinned(reference_speed(rows, false), max_points)});
  if (curves.empty() && figure.empty())
    curves.push_back({"omega_m measured", "true", quantity::omega_m_measured});
  curves.push_back({"omega_m_hat", "hat", quantity::omega_m_hat});
  curves.push_back({"omega_m_ref", "ref", quantity::omega_m_ref});
  figure.draw(rows, curves, max_points);
  return figure;
}

Json run_sections(const RunView& view) {
  Json sections = Json::array();
  std::vector<Json> all = {view.lost() ? loss_section(view) : Json(), whole_run_section(view),
                           view.lost() ? Json() : window_section(view)};
  for (auto* make : {transient_sections, ripple_sections})
    for (Json& section : make(view)) all.push_back(std::move(section));
  for (Json& section : all)
    if (section.is_object() && !section["figures"].empty()) sections.push_back(std::move(section));
  return sections;
}

}  // namespace twinrate::report
