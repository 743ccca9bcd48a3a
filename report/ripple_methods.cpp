// Comparison of runs: the speed ripple of every compensation and filter at every speed.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "report/ripple.hpp"

namespace twinrate::report {
namespace {

constexpr std::size_t kMaxMethods = 8;  // colours of report.js
constexpr int kGridPoints = 1440;

struct Ripple {
  std::string method;
  double speed_rpm = 0;
  Stretch stretch;
};

std::string method_of(const RunView& view, const Stretch& stretch, bool with_filter) {
  std::string method = stretch.compensation;
  if (with_filter) method += ", " + view.run.config.estimator.kind;
  return method;
}

// Speed reference at the end of a stretch, to a tenth of a rpm.
double speed_rpm(const RunView& view, const Stretch& stretch) {
  for (const TickRow& row : view.rows)
    if (row.command && row.t_s >= stretch.to_s)
      return std::round(10 * row.command->omega_m_ref * 60 / kTwoPi) / 10;
  return NAN;
}

// The first stretch of each method at each speed, with whole turns.
std::vector<Ripple> ripples_of(const std::vector<RunView>& views) {
  const bool with_filter = std::any_of(views.begin(), views.end(), [&](const RunView& view) {
    return view.run.config.estimator.kind != views.front().run.config.estimator.kind;
  });
  std::vector<Ripple> ripples;
  for (const RunView& view : views) {
    if (view.lost() || view.rows.empty()) continue;
    for (const Stretch& stretch : ripple_stretches(view)) {
      const Ripple ripple{method_of(view, stretch, with_filter), speed_rpm(view, stretch), stretch};
      const bool known = std::any_of(ripples.begin(), ripples.end(), [&](const Ripple& r) {
        return r.method == ripple.method && r.speed_rpm == ripple.speed_rpm;
      });
      if (!stretch.compensation.empty() && std::isfinite(ripple.speed_rpm) && !known)
        ripples.push_back(ripple);
    }
  }
  return ripples;
}

using BySpeed = std::map<double, const Ripple*>;

struct Methods {
  std::vector<std::string> names;  // in the order of the runs
  std::map<std::string, BySpeed> at;
  std::vector<double> speeds_rpm;
};

Methods methods_of(const std::vector<Ripple>& ripples) {
  Methods methods;
  std::map<double, int> speeds;
  for (const Ripple& ripple : ripples) {
    if (!methods.at.contains(ripple.method)) methods.names.push_back(ripple.method);
    methods.at[ripple.method][ripple.speed_rpm] = &ripple;
    ++speeds[ripple.speed_rpm];
  }
  for (const auto& [speed, count] : speeds) methods.speeds_rpm.push_back(speed);
  return methods;
}

std::string role(std::size_t method) {
  return fmt::format("run{}", method % kMaxMethods);
}

Figure rms_figure(const Methods& methods) {
  Figure figure{.title = "Speed ripple of each compensation",
                .x = methods.speeds_rpm,
                .group = "overlay-ripple"};
  figure.x_label = "speed (rpm)";
  figure.y_label = "ripple rms (rad/s)";
  figure.log_y = true;
  for (std::size_t i = 0; i < methods.names.size(); ++i) {
    Series curve{methods.names[i], role(i), {}};
    const BySpeed& at = methods.at.at(methods.names[i]);
    for (const double speed : methods.speeds_rpm)
      curve.values.push_back(at.contains(speed) ? at.at(speed)->stretch.rms : NAN);
    figure.add(curve);
  }
  return figure;
}

Figure turn_figure(const Methods& methods, double speed) {
  Figure figure{.title = fmt::format("Speed over one turn at {:g} rpm, without its mean", speed),
                .x_label = "angle of the rotor (deg)",
                .y_label = "omega_m (rad/s)"};
  figure.group = "ripple-turn";
  for (int i = 0; i <= kGridPoints; ++i) figure.x.push_back(360.0 * i / kGridPoints);
  for (std::size_t m = 0; m < methods.names.size(); ++m) {
    const BySpeed& at = methods.at.at(methods.names[m]);
    if (!at.contains(speed)) continue;
    const Stretch& stretch = at.at(speed)->stretch;
    Series curve{methods.names[m], role(m), {}};
    for (const double angle_deg : figure.x)
      curve.values.push_back(stretch.spectrum.at(angle_deg / kDegrees, kRippleOrders));
    figure.add(curve);
    figure.note += fmt::format("{}{}: {} turns", figure.note.empty() ? "" : "; ", methods.names[m],
                               stretch.spectrum.turns);
  }
  figure.note = "Orders 1 to 60 of the last whole turns. " + figure.note + ".";
  return figure;
}

std::string cell(const BySpeed& first, const BySpeed& at, double speed) {
  if (!at.contains(speed)) return "-";
  const double rms = at.at(speed)->stretch.rms;
  if (&first == &at || !first.contains(speed)) return fmt::format("{:.4g}", rms);
  return fmt::format("{:.4g} ({})", rms, change_dB(first.at(speed)->stretch.rms, rms));
}

Json method_table(const Methods& methods) {
  Json head = {"compensation"}, rows = Json::array();
  for (const double speed : methods.speeds_rpm) head.push_back(fmt::format("{:g} rpm", speed));
  const BySpeed& first = methods.at.at(methods.names.front());
  for (const std::string& name : methods.names) {
    Json cells = {name};
    for (const double speed : methods.speeds_rpm)
      cells.push_back(cell(first, methods.at.at(name), speed));
    rows.push_back(cells);
  }
  return {{"head", head}, {"rows", rows}};
}

}  // namespace

Json methods_section(const std::vector<RunView>& views) {
  const std::vector<Ripple> ripples = ripples_of(views);
  const Methods methods = methods_of(ripples);
  Json figures = Json::array();
  if (methods.names.size() > 1) {
    if (methods.speeds_rpm.size() > 1) figures.push_back(to_json(rms_figure(methods)));
    for (const double speed : methods.speeds_rpm)
      figures.push_back(to_json(turn_figure(methods, speed)));
  }
  Json section = {{"heading", "Speed ripple of each compensation"},
                  {"note",
                   "True speed less its mean, rad/s rms over the last whole turns of each stretch "
                   "with constant compensation, reference and load. In brackets: the change from "
                   "the first row."},
                  {"columns", 1},
                  {"figures", std::move(figures)}};
  if (methods.names.size() > 1) section["table"] = method_table(methods);
  return section;
}

}  // namespace twinrate::report
