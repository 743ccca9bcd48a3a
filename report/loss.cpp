#include <algorithm>
#include <cmath>

#include "report/parts.hpp"

namespace twinrate::report {
namespace {

constexpr double kTurnsBefore = 5, kTurnsAfter = 8;

// Electrical period just before the loss, from the speed reference, else from the speed.
double period_s(const RunView& view, double lost_s) {
  double omega_m = 0;
  for (const TickRow& row : view.rows) {
    if (row.t_s > lost_s) break;
    const double now = row.command ? row.command->omega_m_ref : view.omega_m(row);
    if (std::isfinite(now)) omega_m = std::abs(now);
  }
  const double shortest_s = 10 * view.run.config.T_s();
  return omega_m > 0 ? std::clamp(kTwoPi / (view.n_p() * omega_m), shortest_s, 0.2) : 0.02;
}

}  // namespace

// Dilys 2021, Fig. 11: the angle error grows, the speed falls and reverses.
Json loss_section(const RunView& view) {
  const double lost_s = view.run.summary.lost_at_s.value_or(view.end_s());
  const double period = period_s(view, lost_s);
  const TickRows around =
      view.between(lost_s - kTurnsBefore * period, lost_s + kTurnsAfter * period);
  Json figures = Json::array();
  const auto push = [&](Figure figure, const char* letter, const char* group) {
    if (figure.empty()) return;
    figure.title = std::string("(") + letter + ") " + figure.title;
    figure.group = group;
    figure.marks = {{lost_s, "lost"}};
    figures.push_back(to_json(figure));
  };
  push(angles_figure(view, around), "a", "loss");
  Figure error = error_figure(view, around);
  error.y_range = {{-180, 180}};
  push(error, "b", "loss");
  Figure speed = speed_figure(view, view.rows);
  speed.title = "Speed after the loss";
  push(speed, "c", "run");
  return {{"heading", "The loss, at " + rates(view)},
          {"note", "The line marks its first sign: " + view.run.summary.lost_why + "."},
          {"columns", 1},
          {"figures", figures}};
}

}  // namespace twinrate::report
