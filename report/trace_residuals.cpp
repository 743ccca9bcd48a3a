// Residuals before and after, and their remaining structure.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"
#include "report/trace_parts.hpp"
#include "trace/correction.hpp"

namespace twinrate::report {
namespace {

constexpr int kOrders = 60;  // shown at least, if the rows resolve them
constexpr int kAngleBins = 240, kBins = 48;
constexpr std::size_t kTimePoints = 5000;
constexpr double kMiddle = 0.99;

std::string unit_label(const std::string& channel) {
  const ChannelWords words = words_of(channel);
  return fmt::format("{} ({})", words.name, words.unit);
}

// Both curves, or one if no effect acts on the channel.
void add_both(Figure& figure, std::vector<double> before, std::vector<double> after) {
  const bool same = before == after;
  if (!same) figure.add({"before", "true", std::move(before)});
  figure.add({same ? "residual" : "after", "hat", std::move(after)});
}

Figure over_time(const TraceSeries& s, const std::string& channel) {
  Figure figure{.title = "Over time", .x_label = "t (s)", .y_label = unit_label(channel), .x = s.t};
  add_both(figure, s.before, s.after);
  figure.shaded = stretches(s.t, s.held_out);
  figure.group = "time";
  figure.note = "Shaded: hold-out.";
  return figure;
}

Figure over_angle(const TraceSeries& s, const std::string& channel) {
  Points points{.x = {}, .e = s.before, .share = {}, .g = {}, .held_out = {}};
  points.share.assign(s.t.size(), 0.0);
  points.held_out.assign(s.t.size(), 0);
  for (const double theta_m : s.theta_m) points.x.push_back(wrap_turn(theta_m) * kDegrees);
  points.g.assign(s.t.size(), 1.0);
  const Bins before = bin(points, 0, 360, kAngleBins);
  points.e = s.after;
  const Bins after = bin(points, 0, 360, kAngleBins);
  Figure figure{.title = "Mean over the angle of the rotor",
                .x_label = "theta_m (deg)",
                .y_label = unit_label(channel),
                .x = before.x};
  add_both(figure, before.trained, after.trained);
  figure.note =
      fmt::format("Means over {:.3g} deg; noise alone gives +- {:.2g} {}.", 360.0 / kAngleBins,
                  middle(after.trained_error, 0).first, words_of(channel).unit);
  return figure;
}

// Some above the highest order that was found.
int orders_to_show(const TraceResult& r) {
  constexpr double kBeyond = 1.2;
  double highest = 0;
  const auto look = [&](const std::vector<TracedEffect>& effects) {
    for (const TracedEffect& e : effects)
      for (const TracedParameter& p : e.parameters)
        if (p.name == "order") highest = std::max(highest, p.value);
  };
  look(r.effects);
  look(r.stop_gaps);
  return std::max(kOrders, static_cast<int>(std::ceil(kBeyond * highest)));
}

Figure over_orders(const TraceSeries& s, const std::string& channel, int orders) {
  std::vector<double> before = order_amplitudes(s.theta_m, s.before, orders);
  if (before.empty()) before = order_amplitudes(s.theta_m, s.before, orders = kOrders);
  Figure figure{.title = "Orders of the angle",
                .x_label = "order (periods a turn)",
                .y_label = fmt::format("amplitude ({})", words_of(channel).unit)};
  if (before.empty()) return figure;
  figure.bars = true;
  for (int N = 1; N <= orders; ++N) figure.x.push_back(N);
  add_both(figure, before, order_amplitudes(s.theta_m, s.after, orders));
  return figure;
}

Figure over_frequency(const TraceSeries& s, const std::string& channel) {
  const Spectrum before = line_spectrum(s.t, s.before, s.rate_Hz);
  Figure figure{.title = "Spectrum in time",
                .x_label = "frequency (Hz)",
                .y_label = fmt::format("amplitude ({})", words_of(channel).unit),
                .x = before.f_Hz};
  add_both(figure, before.amplitude, line_spectrum(s.t, s.after, s.rate_Hz).amplitude);
  figure.log_y = true;
  figure.note =
      fmt::format("The spectrum shows amplitudes of sines; resolution {:.2g} Hz. Drag to zoom.",
                  before.resolution_Hz);
  return figure;
}

std::string fall(const TraceSeries& s, const std::string& unit) {
  double before = 0, after = 0, rows = 0;
  for (std::size_t i = 0; i < s.t.size(); ++i) {
    if (!s.held_out[i]) continue;
    before += s.before[i] * s.before[i], after += s.after[i] * s.after[i], ++rows;
  }
  if (s.before == s.after) return "No traced effect acts on it.";
  if (rows == 0) return "";
  return fmt::format("Hold-out: {:.3g} {} rms before, {:.3g} after.", std::sqrt(before / rows),
                     unit, std::sqrt(after / rows));
}

Json figures_of(std::initializer_list<Figure> figures) {
  Json list = Json::array();
  for (const Figure& figure : figures)
    if (!figure.empty()) list.push_back(to_json(figure, kTimePoints));
  return list;
}

// Label and values of the x axis of a regressor's picture.
std::pair<std::string, std::vector<double>> axis_of(const TraceSeries& s,
                                                    const std::string& regressor) {
  std::vector<double> x = s.t;
  if (regressor == "i_d") return {"i_d (A)", s.i_d};
  if (regressor == "i_q") return {"i_q (A)", s.i_q};
  if (regressor == "omega_m") return {"omega_m (rad/s)", s.omega_m};
  if (regressor == "theta_m") {
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = wrap_turn(s.theta_m[i]) * kDegrees;
    return {"theta_m (deg)", x};
  }
  if (regressor == "direction") {
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = s.omega_m[i] > 0 ? 1 : -1;
    return {"direction of turning", x};
  }
  return {"t (s)", x};
}

Figure structure_figure(const TraceResult& r, const Structure& structure) {
  const std::string channel = structure.channel.empty() ? "torque" : structure.channel;
  const TraceSeries& s = series_of(r, channel);
  auto [label, x] = axis_of(s, structure.regressor);
  Points points{.x = x, .e = s.after, .share = {}, .g = {}, .held_out = s.held_out};
  points.g.assign(s.t.size(), 1.0);
  points.share.assign(s.t.size(), 0.0);
  bool corrected = false;
  for (const CorrectionTable& c : r.corrections) {
    if (c.regressor != structure.regressor || c.channel != channel) continue;
    corrected = true;
    for (std::size_t i = 0; i < s.t.size(); ++i) points.share[i] = c.at(regressor_at(s, i, c));
  }
  const auto [lo, hi] =
      structure.regressor == "theta_m" ? std::pair<double, double>(0, 360) : middle(x, kMiddle);
  Figure figure = bins_figure(bin(points, lo, hi, kBins));
  for (Series& curve : figure.series)
    if (curve.role == "fit") curve.name = "stop-gap correction";
  if (!corrected) std::erase_if(figure.series, [](const Series& c) { return c.role == "fit"; });
  figure.title = structure.text;
  figure.x_label = label;
  figure.y_label = unit_label(channel);
  return figure;
}

std::string correction_text(const CorrectionTable& c) {
  const std::string unit = words_of(c.channel).unit;
  return fmt::format(
      "Stop-gap without a cause: a table of {} points over {} describes the {}. It changes the "
      "held-out error from {:.4g} to {:.4g} {} rms.",
      c.x.size(), c.regressor, words_of(c.channel).name, c.before.held_out, c.after.held_out, unit);
}

}  // namespace

std::vector<Json> residual_sections(const TraceResult& result) {
  std::vector<Json> sections;
  for (const std::string channel : {"torque", "d", "q"}) {
    const TraceSeries& s = series_of(result, channel);
    if (s.t.empty()) continue;
    const ChannelWords words = words_of(channel);
    const std::string change = s.before == s.after ? "" : ", before and after";
    sections.push_back({{"heading", fmt::format("Residual of the {}{}", words.name, change)},
                        {"note", fall(s, words.unit)},
                        {"columns", 2},
                        {"figures", figures_of({over_time(s, channel), over_angle(s, channel),
                                                over_orders(s, channel, orders_to_show(result)),
                                                over_frequency(s, channel)})}});
  }
  return sections;
}

std::vector<Json> picture_sections(const TraceResult& r) {
  std::vector<Json> sections;
  for (const TracePicture& p : r.pictures) {
    const bool of_a_set = p.heading.empty();
    Figure figure{.title = p.title, .x_label = p.x_label, .y_label = p.y_label, .x = p.x};
    std::vector<double> fitted(p.x.size(), std::nan("")), unseen = fitted;
    for (std::size_t i = 0; i < p.x.size(); ++i) (p.held_out[i] ? unseen : fitted)[i] = p.after[i];
    figure.add({"before", "dots0", p.before});
    figure.add({"after, fitted", "dots", fitted});
    figure.add({"after, held out", "dots2", unseen});
    if (figure.empty()) continue;
    const std::string heading = of_a_set ? "Residual, before and after" : p.heading;
    if (sections.empty() || sections.back()["heading"] != heading)
      sections.push_back({{"heading", heading},
                          {"note", of_a_set ? "Every point of the set, less the model." : p.note},
                          {"columns", 2},
                          {"figures", Json::array()}});
    sections.back()["figures"].push_back(to_json(figure));
  }
  return sections;
}

std::vector<Json> unexplained_sections(const TraceResult& r, int n_p) {
  std::vector<Json> sections;
  const char* none =
      r.excluded.empty() ? "No effect of the catalogue" : "No kind that was looked for";
  for (const TracedEffect& line : r.stop_gaps) {
    Json section = effect_section(
        r, line, n_p,
        fmt::format("A periodic torque without a known cause: {}", parameters_text(line)),
        fmt::format(
            "{} was shown to make this line. extended.toml holds it as a stop-gap ({}) that "
            "describes it without a cause.",
            none, line.effect->kind()));
    if (!section.is_null()) sections.push_back(std::move(section));
  }
  Json figures = Json::array();
  std::string note;
  for (const Structure& s : r.unexplained) {
    if (s.frequency_Hz > 0 || s.order > 0) continue;
    const Figure figure = structure_figure(r, s);
    if (!figure.empty()) figures.push_back(to_json(figure));
  }
  for (const CorrectionTable& c : r.corrections)
    note += (note.empty() ? "" : " ") + correction_text(c);
  if (!figures.empty())
    sections.push_back({{"heading", "Unexplained structure of the residual"},
                        {"note", note},
                        {"columns", 2},
                        {"figures", figures}});
  return sections;
}

}  // namespace twinrate::report
