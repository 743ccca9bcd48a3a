// Several runs over one time axis, their steps, and the differences between their drive files.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "analysis/step_response.hpp"
#include "core/config_difference.hpp"
#include "report/parts.hpp"

namespace twinrate::report {
namespace {

constexpr std::size_t kMaxOverlaid = 8;  // colours of report.js
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

using Values = std::function<std::vector<double>(const RunView&)>;

std::vector<double> speeds_of(const RunView& view) {
  return reference_speed(view.rows, view.has_truth());
}

std::vector<double> of_truth(const RunView& view,
                             const std::function<double(const TickRow::OfTruth&)>& value) {
  return values_of(view.rows,
                   [&](const TickRow& row) { return row.truth ? value(*row.truth) : kNaN; });
}

// "n13: dilys2021, twinrate simulate dilys2021 --set rates.n=13".
std::string caption(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  std::string text;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::string command = command_of(views[i].run.manifest_json);
    text +=
        fmt::format("{}{}: drive {}, {}", i == 0 ? "" : "; ", names[i], views[i].run.config.name,
                    command.empty() ? "command not recorded" : command);
  }
  return text;
}

// Curves over the time from the first tick of each run. The reference of each run is drawn once.
class Overlay {
 public:
  Overlay(std::string title, std::string y_label)
      : figure_{.title = std::move(title), .x_label = "t (s)", .y_label = std::move(y_label)} {
    figure_.group = "overlay-time";
  }

  void add(const RunView& view, Series curve, const std::vector<double>& values) {
    const std::size_t column = figure_.series.size();
    if (std::none_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); }))
      return;
    for (std::size_t i = 0; i < values.size(); ++i) {
      auto& row = at_[std::llround(1e9 * (view.rows[i].t_s - view.begin_s()))];
      row.resize(column, kNaN);
      row.push_back(values[i]);
      if (view.lost() || !std::isfinite(values[i])) continue;
      least_ = std::min(least_, values[i]), most_ = std::max(most_, values[i]);
    }
    figure_.series.push_back(std::move(curve));
  }

  // A lost run does not set the range.
  Json json(const std::string& note) {
    const std::size_t columns = figure_.series.size();
    for (const auto& [t_ns, row] : at_) {
      figure_.x.push_back(1e-9 * static_cast<double>(t_ns));
      for (std::size_t c = 0; c < columns; ++c)
        figure_.series[c].values.push_back(c < row.size() ? row[c] : kNaN);
    }
    const double margin = 0.06 * (most_ - least_);
    if (margin > 0) figure_.y_range = {{least_ - margin, most_ + margin}};
    figure_.note = note;
    return to_json(figure_);
  }
  bool empty() const { return figure_.series.empty(); }

 private:
  Figure figure_;
  std::map<long long, std::vector<double>> at_;
  double least_ = INFINITY, most_ = -INFINITY;
};

bool same_reference(const RunView& a, const RunView& b) {
  const ReferenceParameters &r = a.run.config.reference, &s = b.run.config.reference;
  const auto same = [](const Profile& p, const Profile& q) {
    return std::equal(p.steps().begin(), p.steps().end(), q.steps().begin(), q.steps().end(),
                      [](const ProfileStep& x, const ProfileStep& y) {
                        return x.t_s == y.t_s && x.value == y.value;
                      });
  };
  return !r.from_bus && !s.from_bus && a.n_p() == b.n_p() && r.in_rpm == s.in_rpm &&
         r.slew_rate_rad_s2 == s.slew_rate_rad_s2 && same(r.speed_rpm, s.speed_rpm) &&
         same(r.omega_e_rad_s, s.omega_e_rad_s);
}

Json overlays(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  Json figures = Json::array();
  const std::size_t shown = std::min(views.size(), kMaxOverlaid);
  const std::string note = caption(views, names);
  const auto push = [&](const char* title, const char* y_label, const Values& values,
                        const Quantity& reference) {
    Overlay overlay(title, y_label);
    for (std::size_t i = 0; i < shown; ++i)
      overlay.add(views[i], {names[i] + (views[i].lost() ? ", lost" : ""), fmt::format("run{}", i)},
                  values(views[i]));
    if (overlay.empty()) return;
    const bool one = std::all_of(views.begin(), views.end(), [&](const RunView& view) {
      return same_reference(view, views.front());
    });
    if (reference && one && !views.front().lost())
      overlay.add(views.front(), {"reference", "ref"}, values_of(views.front().rows, reference));
    figures.push_back(overlay.json(note));
  };
  push("Speed", "omega_m (rad/s)", speeds_of, quantity::omega_m_ref);
  push("Current along q", "i_q (A)",
       [](const RunView& v) { return values_of(v.rows, current(v, 1)); }, {});
  push("Current along d", "i_d (A)",
       [](const RunView& v) { return values_of(v.rows, current(v, 0)); }, {});
  push("Torque", "T_em (Nm)",
       [](const RunView& v) {
         return of_truth(v, [](const TickRow::OfTruth& t) { return t.T_em; });
       },
       {});
  return figures;
}

std::string time_text(const std::optional<double>& t_s) {
  return t_s ? fmt::format("{:.4g} ms", 1e3 * *t_s) : "-";
}

// "12.3 rad/s, 4.1 %".
std::string speed_text(const std::optional<double>& omega, double of) {
  if (!omega) return "-";
  return of == 0 ? fmt::format("{:.3g} rad/s", *omega)
                 : fmt::format("{:.3g} rad/s, {:.3g} %", *omega, 100 * *omega / std::abs(of));
}

Json step_table(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  std::vector<std::pair<double, Json>> rows;
  for (std::size_t i = 0; i < views.size(); ++i) {
    for (const StepResponse& s :
         step_responses(views[i].rows, speeds_of(views[i]), views[i].run.config)) {
      const double of = s.of_load ? s.reference : s.to - s.from;
      const std::string what =
          fmt::format("{} {:.4g} to {:.4g} {} at {:.4g} s", s.of_load ? "load" : "speed", s.from,
                      s.to, s.of_load ? "Nm" : "rad/s", s.t_s);
      rows.push_back(
          {s.t_s,
           {what, names[i] + (views[i].lost() ? ", lost" : ""), time_text(s.rise_s),
            speed_text(s.overshoot, of), speed_text(s.dip, of), time_text(s.recovery_s)}});
    }
  }
  std::stable_sort(rows.begin(), rows.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  Json table = {{"head", {"step", "run", "rise", "overshoot", "dip", "recovery"}},
                {"rows", Json::array()}};
  for (auto& [t_s, row] : rows) table["rows"].push_back(std::move(row));
  return table;
}

}  // namespace

Json steps_section(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  std::string note =
      "Time from the first tick of each run. Rise: 10 % to 90 % of a step of the speed. Overshoot "
      "and dip: largest excess over and shortfall from the speed wanted, of the step, or of the "
      "reference at a step of the load; a ripple counts. Recovery: until the speed stays within 2 "
      "% of a step of the speed, within a tenth of the largest deviation after a step of the load; "
      "- where it does not stay there for as long as it took.";
  if (views.size() > kMaxOverlaid)
    note += fmt::format(" The figures show the first {} runs.", kMaxOverlaid);
  return {{"heading", "Speed, currents and torque"},
          {"note", note},
          {"columns", 1},
          {"figures", overlays(views, names)},
          {"table", step_table(views, names)}};
}

Json difference_section(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  std::vector<std::string> texts;
  Json head = {"key"};
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].run.log.config_toml.empty()) continue;
    texts.push_back(views[i].run.log.config_toml);
    head.push_back(names[i]);
  }
  Json rows = Json::array();
  for (const DifferingKey& key : differing_keys(texts)) {
    Json row = {key.path};
    for (const std::string& value : key.values) row.push_back(value.empty() ? "-" : value);
    rows.push_back(row);
  }
  std::string note = rows.empty()
                         ? "No key differs."
                         : "Keys of the resolved drive files; - where a file has no such key.";
  if (texts.size() < views.size())
    note += fmt::format(" {} of {} logs hold a drive file.", texts.size(), views.size());
  return {{"heading", "What differs between the drive files"},
          {"note", note},
          {"columns", 1},
          {"figures", Json::array()},
          {"table", {{"head", head}, {"rows", rows}}}};
}

}  // namespace twinrate::report
