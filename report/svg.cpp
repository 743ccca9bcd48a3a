#include "report/svg.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace twinrate::gallery {
namespace {

constexpr double kWidth = 860, kLeft = 78, kRight = 20, kPanel = 210, kTop = 34, kLine = 19;

struct Range {
  double lo = 0, hi = 1;
  double at(double value, double from, double to) const {
    return from + (value - lo) / (hi - lo) * (to - from);
  }
};

Range range_of(const Panel& panel, bool of_x) {
  Range r{1e300, -1e300};
  for (const Curve& curve : panel.curves)
    for (double value : of_x ? curve.x : curve.y)
      r = {std::min(r.lo, value), std::max(r.hi, value)};
  if (panel.bars) r.lo = 0;
  if (r.lo > r.hi) r = {0, 1};
  const double least = std::max(1e-12, 1e-3 * std::max(std::abs(r.lo), std::abs(r.hi)));
  if (r.hi - r.lo < least) r = {r.lo - least, r.hi + least};
  if (of_x) return r;
  const double margin = 0.08 * (r.hi - r.lo);
  return {panel.bars ? r.lo : r.lo - margin, r.hi + (panel.bars ? 2 : 1) * margin};
}

std::vector<double> ticks(const Range& r) {
  const double raw = (r.hi - r.lo) / 5, decade = std::pow(10, std::floor(std::log10(raw)));
  const double step = decade * (raw / decade < 1.5   ? 1
                                : raw / decade < 3.5 ? 2
                                : raw / decade < 7.5 ? 5
                                                     : 10);
  std::vector<double> list;
  for (double value = std::ceil(r.lo / step) * step; value <= r.hi + 1e-9 * step; value += step)
    list.push_back(std::abs(value) < 1e-9 * step ? 0 : value);
  return list;
}

std::string text_at(double x, double y, const std::string& anchor, const std::string& words,
                    const std::string& more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\"{}>{}</text>\n", x, y,
                     anchor, more, words);
}

std::string axes(const Panel& panel, const Range& x, const Range& y, double top, double bottom) {
  std::string out;
  for (double value : ticks(y)) {
    const double at = y.at(value, bottom, top);
    out += fmt::format("<path class=\"g\" d=\"M{} {:.1f}H{}\"/>\n", kLeft, at, kWidth - kRight);
    out += text_at(kLeft - 6, at + 4, "end", fmt::format("{:.6g}", value));
  }
  for (double value : ticks(x))
    out += text_at(x.at(value, kLeft, kWidth - kRight), bottom + 15, "middle",
                   fmt::format("{:.6g}", value));
  out += fmt::format("<path class=\"a\" d=\"M{0} {1:.1f}V{2:.1f}H{3}\"/>\n", kLeft, top, bottom,
                     kWidth - kRight);
  return out + text_at(kWidth - kRight, bottom + 29, "end", panel.x_label) +
         text_at(kLeft, top - 8, "start", panel.title, " font-weight=\"bold\"");
}

std::string bars_of(const Curve& curve, const Range& x, const Range& y, double top, double bottom) {
  std::string path;
  for (std::size_t i = 0; i < curve.x.size(); ++i)
    if (curve.y[i] > 2e-3 * y.hi)
      path += fmt::format("M{:.1f} {:.1f}V{:.1f}", x.at(curve.x[i], kLeft, kWidth - kRight), bottom,
                          y.at(curve.y[i], bottom, top));
  std::string out =
      fmt::format("<path d=\"{}\" stroke=\"{}\" stroke-width=\"4\"/>\n", path, curve.colour);
  std::vector<std::size_t> by_size(curve.y.size());
  std::iota(by_size.begin(), by_size.end(), std::size_t{0});
  std::sort(by_size.begin(), by_size.end(),
            [&](std::size_t a, std::size_t b) { return curve.y[a] > curve.y[b]; });
  for (std::size_t rank = 0; rank < std::min<std::size_t>(7, by_size.size()); ++rank) {
    const std::size_t i = by_size[rank];
    if (curve.y[i] < 0.02 * y.hi) break;
    out += text_at(x.at(curve.x[i], kLeft, kWidth - kRight), y.at(curve.y[i], bottom, top) - 4,
                   "middle", fmt::format("{:g}", curve.x[i]));
  }
  return out;
}

std::string curve_of(const Curve& curve, const Range& x, const Range& y, double top,
                     double bottom) {
  std::string points;
  for (std::size_t i = 0; i < curve.x.size(); ++i)
    points += fmt::format("{:.1f},{:.1f} ", x.at(curve.x[i], kLeft, kWidth - kRight),
                          y.at(curve.y[i], bottom, top));
  return fmt::format("<polyline points=\"{}\" stroke=\"{}\"/>\n", points, curve.colour);
}

double height_of(const Panel& panel) {
  return panel.empty_note.empty() ? kPanel : 60;
}

std::string panel_at(const Panel& panel, double top) {
  const double bottom = top + kPanel - 70;
  if (!panel.empty_note.empty())
    return text_at(kLeft, top - 8, "start", panel.title, " font-weight=\"bold\"") +
           text_at(kLeft, top + 14, "start", panel.empty_note);
  const Range x = range_of(panel, true), y = range_of(panel, false);
  std::string out = axes(panel, x, y, top, bottom);
  double legend = kWidth - kRight;
  for (const Curve& curve : panel.curves) {
    out += panel.bars ? bars_of(curve, x, y, top, bottom) : curve_of(curve, x, y, top, bottom);
    if (curve.name.empty()) continue;
    out += text_at(legend, top - 8, "end", curve.name, fmt::format(" fill=\"{}\"", curve.colour));
    legend -= 7.2 * static_cast<double>(curve.name.size()) + 14;
  }
  return out;
}

}  // namespace

std::string svg(const std::string& title, const std::vector<Panel>& panels,
                const std::string& lines_title, const std::vector<Line>& lines) {
  double panels_end = kTop;
  for (const Panel& panel : panels) panels_end += height_of(panel);
  const double height = panels_end + 24 + kLine * static_cast<double>(lines.size());
  std::string out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:g} {1:g}\" width=\"{0:g}\" "
      "height=\"{1:g}\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#333\">\n<style>"
      "polyline{{fill:none;stroke-width:1.3}}.g{{stroke:#e4e4e4}}.a{{stroke:#888;fill:none}}"
      "</style>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
      kWidth, height);
  out += text_at(10, 20, "start", title, " font-size=\"15\" font-weight=\"bold\"");
  double top = kTop + 24;
  for (const Panel& panel : panels) {
    out += panel_at(panel, top);
    top += height_of(panel);
  }
  out += text_at(kLeft, panels_end + 6, "start", lines_title, " font-weight=\"bold\"");
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const double y = panels_end + 26 + kLine * static_cast<double>(i);
    out += text_at(kLeft + 104, y, "end", lines[i].name);
    out += fmt::format(
        "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"11\" fill=\"#1f6feb\"/>\n",
        kLeft + 112, y - 10, 1 + 260 * std::clamp(lines[i].length, 0.0, 1.0));
    out += text_at(kLeft + 384, y, "start", lines[i].text);
  }
  return out + "</svg>\n";
}

}  // namespace twinrate::gallery
