// One effect drawn over the data that shows it: what is plotted against what is chosen by its kind;
// every kind can be plotted as residual against its own share (a line of slope one).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "model/frames.hpp"
#include "tools/report/trace_parts.hpp"

namespace twinrate::report {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kBins = 48, kPeriodBins = 60;
constexpr double kMiddle = 0.99;  // of the rows: the axis is not stretched by few
constexpr double kExcerpt_s = 0.25;
constexpr double kSlowRatio = 0.02;  // of its mean square: an effect that hardly changes
constexpr double kStandsOut = 0.3;   // of the clearest channel
constexpr double kShown = 0.5;       // of the effect's power, by an axis worth drawing
constexpr double kMisfit = 0.25;     // of a residual that is the effect
constexpr double kBase = 0.15;       // of the largest speed, current: below it no division

// A picture in the making.
struct Plot {
  Points points;
  std::string title, x_label, y_label, note;
  double lo = 0, hi = 1;
  int bins = kBins;
};

// The rows of one channel.
struct Rows {
  const TraceSeries& s;
  const EffectView& view;
  ChannelWords words;
  int n_p;

  std::size_t size() const { return s.t.size(); }
  double theta_e(std::size_t i) const { return n_p * s.theta_m[i]; }
};

Points points_of(const Rows& rows) {
  Points p;
  p.e = rows.view.without;
  p.share = rows.view.share;
  p.held_out = rows.s.held_out;
  p.g.assign(rows.size(), 1.0);
  return p;
}

template <class Of>
std::vector<double> each(std::size_t count, Of&& of) {
  std::vector<double> values(count);
  for (std::size_t i = 0; i < count; ++i) values[i] = of(i);
  return values;
}

// Rows where the divisor is small say little and are left out.
void keep_large(Points& p) {
  double largest = 0;
  for (const double g : p.g) largest = std::max(largest, std::abs(g));
  Points kept;
  for (std::size_t i = 0; i < p.x.size(); ++i) {
    if (std::abs(p.g[i]) < kBase * largest) continue;
    kept.x.push_back(p.x[i]), kept.e.push_back(p.e[i]), kept.share.push_back(p.share[i]);
    kept.g.push_back(p.g[i]), kept.held_out.push_back(p.held_out[i]);
  }
  p = std::move(kept);
}

Plot over(const Rows& rows, std::string title, std::string x_label, std::vector<double> x) {
  Plot plot{.points = points_of(rows), .title = std::move(title), .x_label = std::move(x_label)};
  plot.y_label = fmt::format("{} ({})", rows.words.name, rows.words.unit);
  plot.points.x = std::move(x);
  std::tie(plot.lo, plot.hi) = middle(plot.points.x, kMiddle);
  return plot;
}

Plot over_period(const Rows& rows, double order) {
  Plot plot = over(
      rows, order == 1 ? "Over one turn" : fmt::format("Over one period, {:.4g} a turn", order),
      "angle of the rotor in the period (deg)", each(rows.size(), [&](std::size_t i) {
        return wrap_turn(order * rows.s.theta_m[i]) / order * kDegrees;
      }));
  plot.lo = 0, plot.hi = 360 / order, plot.bins = kPeriodBins;
  return plot;
}

Plot over_cycle(const Rows& rows, double f_Hz) {
  Plot plot = over(rows, fmt::format("Over one period of {:.5g} Hz", f_Hz),
                   "time in the period (ms)", each(rows.size(), [&](std::size_t i) {
                     return wrap_turn(kTwoPi * f_Hz * rows.s.t[i]) / kTwoPi / f_Hz * 1e3;
                   }));
  plot.lo = 0, plot.hi = 1e3 / f_Hz, plot.bins = kPeriodBins;
  return plot;
}

Plot over_speed(const Rows& rows) {
  return over(rows, "Over the speed", "omega_m (rad/s)", rows.s.omega_m);
}

// Flux linkage that the voltage of rotation shows: e_d = -omega_e psi_q, e_q = omega_e psi_d.
Plot flux_over(const Rows& rows, std::string x_label, std::vector<double> x) {
  const bool d = rows.view.channel == "d";
  const std::string flux = d ? "psi_q" : "psi_d";
  const std::string title = fmt::format("Missing {} over {}", flux, x_label.substr(0, 3));
  Plot plot = over(rows, title, std::move(x_label), std::move(x));
  plot.y_label = fmt::format("missing {} (mWb)", flux);
  plot.note = fmt::format("{} over the electrical speed, fast rows only.", rows.words.name);
  const double sign = d ? -1e-3 : 1e-3;
  plot.points.g =
      each(rows.size(), [&](std::size_t i) { return sign * rows.n_p * rows.s.omega_m[i]; });
  keep_large(plot.points);
  return plot;
}

Plot resistance_over_time(const Rows& rows) {
  const bool d = rows.view.channel == "d";
  Plot plot = over(rows, "Over time", "t (s)", rows.s.t);
  plot.y_label = "missing resistance (Ohm)";
  plot.note = fmt::format("{} over {}, rows with a large current only.", rows.words.name,
                          d ? "i_d" : "i_q");
  plot.points.g = d ? rows.s.i_d : rows.s.i_q;
  keep_large(plot.points);
  return plot;
}

// Voltage error of the phases over their own currents, the three of them pooled.
Plot over_phase_current(const TraceResult& r, const TracedEffect& effect, int n_p) {
  const EffectView *d = nullptr, *q = nullptr;
  for (const EffectView& view : effect.views) {
    if (view.channel == "d") d = &view;
    if (view.channel == "q") q = &view;
  }
  Plot plot{.points = {}, .title = "Over the phase current", .x_label = "current of the phase (A)"};
  plot.y_label = "voltage of the phase (V)";
  plot.note = "The three phases together.";
  if (!d || !q) return plot;
  const TraceSeries& s = r.series_q;
  for (std::size_t i = 0; i < s.t.size(); ++i) {
    const double theta_e = n_p * s.theta_m[i];
    const auto phases = [&](double x_d, double x_q) {
      return inverse_clarke(inverse_park(Vec2(x_d, x_q), theta_e));
    };
    const Vec3 current = phases(s.i_d[i], s.i_q[i]), e = phases(d->without[i], q->without[i]),
               share = phases(d->share[i], q->share[i]);
    for (int phase = 0; phase < 3; ++phase) {
      plot.points.x.push_back(current[phase]);
      plot.points.e.push_back(e[phase]);
      plot.points.share.push_back(share[phase]);
      plot.points.g.push_back(1);
      plot.points.held_out.push_back(s.held_out[i]);
    }
  }
  std::tie(plot.lo, plot.hi) = middle(plot.points.x, kMiddle);
  return plot;
}

// The picture that every kind has.
Plot over_share(const Rows& rows, std::size_t half) {
  Plot plot = over(rows, "Against what the effect predicts",
                   fmt::format("the effect's {} ({})", rows.words.name, rows.words.unit),
                   smooth(rows.view.share, rows.s.t, rows.s.rate_Hz, half));
  plot.points.e = smooth(rows.view.without, rows.s.t, rows.s.rate_Hz, half);
  plot.points.share = plot.points.x;
  plot.note = "If the effect is there, points stand on the line of slope one.";
  return plot;
}

double key_of(const TracedEffect& e, const char* name) {
  for (const TracedParameter& p : e.parameters)
    if (p.name == name) return p.value;
  return 0;
}

bool one_of(const std::set<std::string_view>& kinds, std::string_view kind) {
  return kinds.contains(kind);
}

// Axis on which this kind can be seen by eye.
Plot plot_of(const TraceResult& r, const TracedEffect& effect, const Rows& rows, std::size_t half) {
  const std::string_view kind = effect.effect->kind();
  const bool torque = rows.view.channel == "torque", d = rows.view.channel == "d";
  if (one_of({"dead_time", "inverter_drop"}, kind) && !torque)
    return over_phase_current(r, effect, rows.n_p);
  if (kind == "resistance" && !torque) return resistance_over_time(rows);
  if (one_of({"inductance", "saturation"}, kind) && !torque)
    return d ? flux_over(rows, "i_q (A)", rows.s.i_q) : flux_over(rows, "i_d (A)", rows.s.i_d);
  if (kind == "cross_saturation" && !torque)
    return d ? flux_over(rows, "i_d (A)", rows.s.i_d) : flux_over(rows, "i_q (A)", rows.s.i_q);
  if (kind == "flux_linkage" && !torque) return over_speed(rows);
  if (!torque) return over_share(rows, half);
  const double order = kind == "eccentric_load" ? 1 : key_of(effect, "order");
  if (one_of({"cogging", "eccentric_load", "periodic_torque"}, kind) && order > 0)
    return over_period(rows, order);
  if (kind == "periodic_torque") return over_cycle(rows, key_of(effect, "frequency"));
  if (kind == "friction_ripple" && order > 0) {
    Plot plot = over_period(rows, order);
    plot.note = "Against the motion: torque times the sign of the speed.";
    plot.points.g =
        each(rows.size(), [&](std::size_t i) { return rows.s.omega_m[i] < 0 ? -1.0 : 1.0; });
    return plot;
  }
  if (one_of({"viscous_friction", "coulomb_friction", "stribeck_friction", "fan_load",
              "constant_load"},
             kind))
    return over_speed(rows);
  if (kind == "load_step") return over(rows, "Over time", "t (s)", rows.s.t);
  return over_share(rows, half);
}

Figure figure_of(const Plot& plot) {
  Figure figure = bins_figure(bin(plot.points, plot.lo, plot.hi, plot.bins));
  figure.title = plot.title;
  figure.x_label = plot.x_label;
  figure.y_label = plot.y_label;
  figure.note = plot.note;
  return figure;
}

// First and last row + 1 of the stretch in which the effect changes most, held-out rows before
// others; the whole record where it hardly changes in any.
std::pair<std::size_t, std::size_t> liveliest(const Rows& rows) {
  const std::size_t n = rows.size();
  const auto length = static_cast<std::size_t>(kExcerpt_s * rows.s.rate_Hz);
  if (n <= length || length < 8) return {0, n};
  bool any_held = std::any_of(rows.s.held_out.begin(), rows.s.held_out.end(),
                              [](char held) { return held != 0; });
  double most = 0, square = 0;
  std::pair<std::size_t, std::size_t> best{0, n};
  for (std::size_t from = 0; from + length <= n; from += length / 8) {
    const std::size_t to = from + length;
    if (any_held && !(rows.s.held_out[from] && rows.s.held_out[to - 1])) continue;
    if (rows.s.t[to - 1] - rows.s.t[from] > 1.2 * kExcerpt_s) continue;
    double sum = 0, squares = 0;
    for (std::size_t i = from; i < to; ++i) {
      sum += rows.view.share[i];
      squares += rows.view.share[i] * rows.view.share[i];
    }
    const double variance = squares - sum * sum / static_cast<double>(length);
    if (variance > most) most = variance, square = squares, best = {from, to};
  }
  if (most < kSlowRatio * square) return {0, n};
  return best;
}

Figure excerpt(const Rows& rows, std::size_t half) {
  const auto [from, to] = liveliest(rows);
  const bool whole = to - from == rows.size();
  Figure figure{.title = whole ? "Over time" : "A stretch of time in which it acts",
                .x_label = "t (s)",
                .y_label = fmt::format("{} ({})", rows.words.name, rows.words.unit)};
  const std::vector<double> e = smooth(rows.view.without, rows.s.t, rows.s.rate_Hz, half),
                            share = smooth(rows.view.share, rows.s.t, rows.s.rate_Hz, half);
  const auto part = [&, from = from, to = to](const std::vector<double>& y) {
    return std::vector<double>(y.begin() + static_cast<std::ptrdiff_t>(from),
                               y.begin() + static_cast<std::ptrdiff_t>(to));
  };
  figure.x = part(rows.s.t);
  figure.add({"residual without the effect in the model", "true", part(e)});
  figure.add({"the effect", "hat", part(share)});
  if (whole) {
    figure.shaded = stretches(rows.s.t, rows.s.held_out);
    figure.note = "Shaded: kept back from the fit. ";
  } else if (rows.s.held_out[from]) {
    figure.note = "Kept back from the fit. ";
  }
  if (half > 0)
    figure.note += fmt::format("Both as moving averages over {:.3g} ms.",
                               1e3 * static_cast<double>(2 * half + 1) / rows.s.rate_Hz);
  return figure;
}

double rms(const std::vector<double>& y) {
  double sum = 0;
  for (const double value : y) sum += value * value;
  return y.empty() ? 0 : std::sqrt(sum / static_cast<double>(y.size()));
}

double standing(const TraceResult& r, const EffectView& view) {
  return rms(view.share) / std::max(1e-300, rms(series_of(r, view.channel).after));
}

// The view in which the effect stands out most from what is left.
const EffectView& clearest(const TraceResult& r, const TracedEffect& effect) {
  return *std::max_element(
      effect.views.begin(), effect.views.end(),
      [&](const EffectView& a, const EffectView& b) { return standing(r, a) < standing(r, b); });
}

// Share of the effect's own power that is a function of the picture's axis.
double explained(const Plot& plot) {
  std::vector<double> sg(static_cast<std::size_t>(plot.bins), 0.0), gg = sg;
  double whole = 0, part = 0;
  const Points& p = plot.points;
  for (std::size_t i = 0; i < p.x.size(); ++i) {
    if (!(p.x[i] >= plot.lo && p.x[i] <= plot.hi)) continue;
    const auto b =
        std::min(sg.size() - 1,
                 static_cast<std::size_t>((p.x[i] - plot.lo) / (plot.hi - plot.lo) * plot.bins));
    sg[b] += p.share[i] * p.g[i], gg[b] += p.g[i] * p.g[i];
    whole += p.share[i] * p.share[i];
  }
  for (std::size_t b = 0; b < sg.size(); ++b)
    if (gg[b] > 0) part += sg[b] * sg[b] / gg[b];
  return whole > 0 ? part / whole : 0;
}

// The picture on the axis that shows most of the effect, among the channels in which it stands out;
// against its own prediction where no axis shows enough.
Plot best_plot(const TraceResult& r, const TracedEffect& effect, int n_p, const Rows& clear,
               std::size_t half) {
  Plot best;
  double most = 0;
  for (const EffectView& view : effect.views) {
    if (standing(r, view) < kStandsOut * standing(r, clear.view)) continue;
    const Rows rows{series_of(r, view.channel), view, words_of(view.channel), n_p};
    Plot plot = plot_of(r, effect, rows, widest_half(view.share, rows.s.t, rows.s.rate_Hz));
    // The share itself is the last resort.
    const double shown = plot.points.x == plot.points.share ? 0 : explained(plot);
    if (shown > most) most = shown, best = std::move(plot);
  }
  return most > kShown ? best : over_share(clear, half);
}

// Least-squares factor of the residual over the effect on one kind of rows.
double factor(const Rows& rows, std::size_t half, bool held_out) {
  const std::vector<double> e = smooth(rows.view.without, rows.s.t, rows.s.rate_Hz, half),
                            share = smooth(rows.view.share, rows.s.t, rows.s.rate_Hz, half);
  double product = 0, square = 0;
  for (std::size_t i = 0; i < e.size(); ++i) {
    if ((rows.s.held_out[i] != 0) != held_out) continue;
    product += e[i] * share[i], square += share[i] * share[i];
  }
  return square > 0 ? product / square : kNaN;
}

}  // namespace

Figure bins_figure(const Bins& bins) {
  Figure figure;
  figure.x = bins.x;
  figure.add({"data, fitted", "dots", bins.trained, false, bins.trained_error});
  figure.add({"data, kept back", "dots2", bins.held_out, false, bins.held_out_error});
  figure.add({"the effect", "fit", bins.share});
  return figure;
}

Json effect_section(const TraceResult& result, const TracedEffect& effect, int n_p,
                    const std::string& heading, const std::string& note) {
  if (effect.views.empty()) return Json();
  const EffectView& view = clearest(result, effect);
  const Rows rows{series_of(result, view.channel), view, words_of(view.channel), n_p};
  const std::size_t half = widest_half(view.share, rows.s.t, rows.s.rate_Hz);
  const double unseen = factor(rows, half, true);
  std::string text = note;
  if (std::isfinite(unseen))
    text += fmt::format(" On the data kept back the residual is {:.3f} times what the effect says.",
                        unseen);
  if (std::isfinite(unseen) && std::abs(unseen - 1) > kMisfit)
    text += " That is not 1: the data do not carry this claim.";
  Json figures = Json::array();
  for (const Figure& figure :
       {figure_of(best_plot(result, effect, n_p, rows, half)), excerpt(rows, half)})
    if (!figure.empty()) figures.push_back(to_json(figure));
  return {{"heading", heading}, {"note", text}, {"columns", 2}, {"figures", figures}};
}

}  // namespace twinrate::report
