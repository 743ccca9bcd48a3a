// The pictures of one effect: over the axis that shows it best, and over a stretch of time.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "report/trace_plots.hpp"

namespace twinrate::report {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kExcerpt_s = 0.25;
constexpr double kMinVariance = 0.02;   // over the mean square, of an effect drawn by an excerpt
constexpr double kMinVisibility = 0.3;  // of a channel, relative to the clearest channel
constexpr double kMinExplained = 0.5;   // share of the effect's power shown by an axis
constexpr double kMaxMisfit = 0.25;     // of the held-out factor from 1

Figure figure_of(const Plot& plot) {
  Figure figure = bins_figure(bin(plot.points, plot.lo, plot.hi, plot.bins));
  figure.title = plot.title;
  figure.x_label = plot.x_label;
  figure.y_label = plot.y_label;
  figure.note = plot.note;
  return figure;
}

// Rows [first, last) of the stretch with the largest variance of the effect, among held-out rows if
// there are any; the whole record if the variance is small.
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
  if (most < kMinVariance * square) return {0, n};
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
    figure.note = "Shaded: hold-out. ";
  } else if (rows.s.held_out[from]) {
    figure.note = "Hold-out. ";
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

// Ratio of the effect to the residual of its channel, rms.
double visibility(const TraceResult& r, const EffectView& view) {
  return rms(view.share) / std::max(1e-300, rms(series_of(r, view.channel).after));
}

// The view of the effect with the largest visibility.
const EffectView& clearest(const TraceResult& r, const TracedEffect& effect) {
  return *std::max_element(effect.views.begin(), effect.views.end(),
                           [&](const EffectView& a, const EffectView& b) {
                             return visibility(r, a) < visibility(r, b);
                           });
}

// Share of the effect's power that is a function of the picture's axis.
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

// The picture on the axis that shows most of the effect, among the channels with enough visibility;
// over the effect's own prediction if no axis shows enough.
Plot best_plot(const TraceResult& r, const TracedEffect& effect, int n_p, const Rows& clear,
               std::size_t half) {
  Plot best;
  double most = 0;
  for (const EffectView& view : effect.views) {
    if (visibility(r, view) < kMinVisibility * visibility(r, clear.view)) continue;
    const Rows rows{series_of(r, view.channel), view, words_of(view.channel), n_p};
    Plot plot = plot_of(r, effect, rows, widest_half(view.share, rows.s.t, rows.s.rate_Hz));
    // The picture over the share itself has the lowest rank.
    const double shown = plot.points.x == plot.points.share ? 0 : explained(plot);
    if (shown > most) most = shown, best = std::move(plot);
  }
  return most > kMinExplained ? best : over_share(clear, half);
}

// Least-squares factor c of residual = c effect, on held-out or on training rows.
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
  figure.add({"data, held out", "dots2", bins.held_out, false, bins.held_out_error});
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
    text += fmt::format(" On the hold-out the residual is {:.3f} times the effect.", unseen);
  if (std::isfinite(unseen) && std::abs(unseen - 1) > kMaxMisfit)
    text += " This is not 1: the data do not support this effect.";
  Json figures = Json::array();
  for (const Figure& figure :
       {figure_of(best_plot(result, effect, n_p, rows, half)), excerpt(rows, half)})
    if (!figure.empty()) figures.push_back(to_json(figure));
  return {{"heading", heading}, {"note", text}, {"columns", 2}, {"figures", figures}};
}

}  // namespace twinrate::report
