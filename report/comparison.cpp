#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "report/parts.hpp"

namespace twinrate::report {
namespace {

constexpr std::size_t kGridPoints = 2500;
constexpr std::size_t kMaxOverlaid = 4;
constexpr double kMinRange_deg = 0.2;  // of the y axis of angle errors

std::string rate_name(const RunView& view) {
  const DriveConfig& config = view.run.config;
  return fmt::format("f_b = {} (n = {})", frequency(config.rates.f_s_Hz / config.rates.n),
                     config.rates.n);
}

std::string policy_name(const RunView& view) {
  return kGainPolicyNames[static_cast<int>(view.run.config.gain.policy)];
}

// Text of a constant speed reference, such as "20 rpm".
std::string speed_name(const RunView& view) {
  const ReferenceParameters& reference = view.run.config.reference;
  if (!reference.from_bus && reference.in_rpm && reference.speed_rpm.is_constant())
    return fmt::format("{:g} rpm", reference.speed_rpm.at(0));
  if (!reference.from_bus && !reference.in_rpm && reference.omega_e_rad_s.is_constant())
    return fmt::format("{:g} rad/s", reference.omega_e_rad_s.at(0));
  return "";
}

// Filter and compensation, such as "ekf_disturbance off to paper".
std::string method_name(const RunView& view) {
  const DriveConfig& config = view.run.config;
  std::string name = config.estimator.kind;
  if (config.controller.kind != "lqr") return name;
  const char* before = nullptr;
  for (const ProfileStep& step : config.controller.compensation.steps()) {
    const char* kind =
        kCompensationNames[static_cast<int>(config.controller.compensation_at(step.t_s))];
    if (!before || std::string_view(before) != kind)
      name += fmt::format("{}{}", before ? " to " : " ", kind);
    before = kind;
  }
  return name;
}

std::string controller_name(const RunView& view) {
  return view.run.config.controller.kind;
}

// Names of runs: the parts of rate, policy, speed, controller and method that differ, else the path. Runs that
// differ only in their paths are named by rate and path.
std::vector<std::string> run_names(const std::vector<RunView>& views) {
  std::vector<std::string> names(views.size());
  const auto append = [](std::string& name, const std::string& part) {
    name += (name.empty() || part.empty() ? "" : ", ") + part;
  };
  for (const auto& part_of : {rate_name, policy_name, speed_name, controller_name, method_name}) {
    const bool differs = std::any_of(views.begin(), views.end(), [&](const RunView& view) {
      return part_of(view) != part_of(views.front());
    });
    if (!differs) continue;
    for (std::size_t i = 0; i < views.size(); ++i) append(names[i], part_of(views[i]));
  }
  const std::vector<std::string> parts = names;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (parts[i].empty()) names[i] = rate_name(views[i]);
    if (std::count(parts.begin(), parts.end(), parts[i]) > 1)
      append(names[i], views[i].run.log.path);
  }
  return names;
}

// One y range for all runs that kept synchronism, for comparison.
std::pair<double, double> common_range(const std::vector<RunView>& views) {
  double least = 0, greatest = 0;
  for (const RunView& view : views) {
    if (view.lost()) continue;
    const auto error = quantity::angle_error_deg(view.reference, view.n_p());
    for (const TickRow& row : view.rows) {
      const double error_deg = row.t_s < view.settled_s() ? NAN : error(row);
      if (std::isfinite(error_deg))
        least = std::min(least, error_deg), greatest = std::max(greatest, error_deg);
    }
  }
  const double margin = std::max(0.05 * (greatest - least), 0.05);
  return {least - margin, greatest + margin};
}

Json error_grid(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  Json figures = Json::array();
  const auto range = common_range(views);
  const bool none_lost =
      std::none_of(views.begin(), views.end(), [](const RunView& view) { return view.lost(); });
  const bool nothing_to_see = none_lost && range.second - range.first < kMinRange_deg;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const RunView& view = views[i];
    Figure figure = error_figure(
        view, view.lost() ? view.rows : view.between(view.settled_s(), view.end_s()), kGridPoints);
    if (figure.empty() || nothing_to_see) continue;
    figure.title = fmt::format("({}) {}{}", static_cast<char>('a' + i % 26), names[i],
                               view.lost() ? ", lost" : "");
    figure.y_range = view.lost() ? std::pair(-180.0, 180.0) : range;
    figure.series.front().role = view.lost() ? "lost" : "hat";
    figure.group = view.lost() ? "" : "grid";
    figures.push_back(to_json(figure));
  }
  return {{"heading", "Angle errors"},
          {"note", "From settle_s on, all on one scale; lost runs are shown whole, on +/-180 deg."},
          {"columns", 3},
          {"figures", figures}};
}

// A quantity of several runs over electrical turns, counted from the crossing of theta_e = 0 in
// each run.
Figure overlay(const std::vector<RunView>& views, const std::vector<std::string>& names,
               const Quantity& quantity) {
  Figure figure{.x_label = "electrical turns"};
  std::vector<std::pair<double, std::pair<std::size_t, double>>> points;
  std::size_t shown = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const RunView& view = views[i];
    if (view.rows.empty() || view.lost() || !view.has_P44() || shown == kMaxOverlaid) continue;
    const TickRows window = view.short_window();
    const auto turns_of = [&](const TickRow& row) {
      return theta_e_reference(row, view.reference, view.n_p()) / kTwoPi;
    };
    const double direction = turns_of(window.back()) < turns_of(window.front()) ? -1 : 1;
    const double start = std::floor(direction * turns_of(window.front()));
    for (const TickRow& row : window) {
      const double turns = direction * turns_of(row) - start;
      if (std::isfinite(turns)) points.push_back({turns, {shown, quantity(row)}});
    }
    figure.series.push_back({names[i], fmt::format("run{}", shown), {}, true});
    ++shown;
  }
  std::stable_sort(points.begin(), points.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  for (const auto& [turns, value] : points) {
    figure.x.push_back(turns);
    for (std::size_t s = 0; s < shown; ++s)
      figure.series[s].values.push_back(s == value.first ? value.second : NAN);
  }
  return figure;
}

Json overlay_section(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  Json figures = Json::array();
  const auto push = [&](const char* title, const char* y_label, const Quantity& quantity) {
    Figure figure = overlay(views, names, quantity);
    if (figure.x.empty() || figure.series.size() < 2) return;
    figure.title = title;
    figure.y_label = y_label;
    figure.group = "overlay";
    figures.push_back(to_json(figure, figure.x.size()));
  };
  push("Angle variance", "P44 (rad²)", quantity::P44);
  push("Gain K41 as held", "K41 (rad/A)", quantity::K41);
  push("Gain K42 as held", "K42 (rad/A)", quantity::K42);
  return {{"heading", "Variance and gains over the last electrical turns"},
          {"note", "Locked runs (the first four), each counted from theta_e = 0."},
          {"columns", 1},
          {"figures", figures}};
}

std::string verdict_word(const Summary& s) {
  if (s.trip) return fmt::format("tripped at {:.3g} s", s.trip->t_s);
  if (!s.locked) return "-";
  if (!*s.locked && !s.lost_at_s) return "not locked";
  if (!*s.locked) return fmt::format("lost at {:.3g} s", s.lost_at_s.value_or(0));
  const std::string word = speed_word(s);
  return word.empty() ? "locked" : "locked, " + word;
}

}  // namespace

Json comparison_table(const std::vector<RunView>& views) {
  Json rows = Json::array();
  for (const RunView& view : views) {
    const Summary& s = view.run.summary;
    const DriveConfig& config = view.run.config;
    rows.push_back(
        {view.run.log.path, config.name, std::to_string(config.rates.n),
         frequency(config.rates.f_s_Hz / config.rates.n),
         kGainPolicyNames[static_cast<int>(config.gain.policy)], verdict_word(s),
         degrees(s.angle_error_rms), degrees(s.angle_error_max),
         s.speed_error_rms ? fmt::format("{:.3g}", *s.speed_error_rms) : "-",
         s.P44_min && s.P44_max ? fmt::format("{:.3g} .. {:.3g}", *s.P44_min, *s.P44_max) : "-"});
  }
  const Json head = {"run",     "drive",    "n",        "f_b",          "policy",
                     "verdict", "rms, deg", "max, deg", "speed, rad/s", "P44, rad²"};
  return {{"head", head}, {"rows", rows}};
}

Json comparison_sections(const std::vector<RunView>& views) {
  const std::vector<std::string> names = run_names(views);
  Json sections = Json::array();
  for (Json section : {methods_section(views), steps_section(views, names),
                       error_grid(views, names), overlay_section(views, names),
                       shape_section(views, names), reduction_section(views, names)})
    if (!section["figures"].empty()) sections.push_back(section);
  sections.push_back(difference_section(views, names));
  return sections;
}

}  // namespace twinrate::report
