#include "bench/robustness_figure.hpp"

#include <fmt/format.h>

#include <cmath>

namespace twinrate {
namespace {

struct Style {
  const char *estimator, *colour, *more;
  bool below;  // in the lower row
};
constexpr Style kStyles[] = {
    {"eemf", "#1f5fa8", "stroke-width='4' opacity='.45'", false},
    {"active_flux", "#c8501e", "stroke-width='1.5' stroke-dasharray='5 4'", false},
    {"dq_ekf", "#2c8a4b", "stroke-width='1.8'", false},
    {"backemf_printed", "#7a3fa0", "stroke-width='1.8'", true},
};
constexpr const char* kParameters[] = {"R_s", "L_q", "psi_f"};

struct Box {
  double left, top, width, height, span_pct, lo, hi;
  double x(double pct) const { return left + (pct / span_pct + 1) / 2 * width; }
  double y(double deg) const { return top + (hi - deg) / (hi - lo) * height; }
};

Box box_of(int column, bool below) {
  const double left = 62 + 272 * column, span = kParameterSpan_pct[column];
  return below ? Box{left, 298, 240, 130, span, -20, 60} : Box{left, 62, 240, 190, span, -10, 10};
}

std::string axes(const Box& b, const char* parameter, double step) {
  std::string s;
  for (double v = b.lo; v <= b.hi; v += step)
    s += fmt::format(
        "<line class='{}' x1='{:.1f}' x2='{:.1f}' y1='{:.1f}' y2='{:.1f}'/>"
        "<text class='e' x='{:.1f}' y='{:.1f}'>{:g}</text>\n",
        v == 0 ? "z" : "g", b.left, b.left + b.width, b.y(v), b.y(v), b.left - 5, b.y(v) + 4, v);
  for (double v = -b.span_pct; v <= b.span_pct; v += b.span_pct / 2)
    s += fmt::format(
        "<line class='{}' x1='{:.1f}' x2='{:.1f}' y1='{:.1f}' y2='{:.1f}'/>"
        "<text class='m' x='{:.1f}' y='{:.1f}'>{}</text>\n",
        v == 0 ? "z" : "g", b.x(v), b.x(v), b.top, b.top + b.height, b.x(v), b.top + b.height + 15,
        v == 0 ? "0" : fmt::format("{:+g}", v));
  return s + fmt::format("<text class='m' x='{:.1f}' y='{:.1f}'>{}, % off</text>\n", b.x(0),
                         b.top + b.height + 30, parameter);
}

const Style& style_of(const std::string& estimator) {
  for (const Style& style : kStyles)
    if (style.estimator == estimator) return style;
  return kStyles[0];
}

std::string line(const RobustnessCurve& curve) {
  const Style& style = style_of(curve.estimator);
  const Box b = box_of(curve.column, style.below);
  std::string points, crosses;
  for (std::size_t i = 0; i < curve.x_pct.size(); ++i)
    if (std::isnan(curve.e_deg[i]))
      crosses +=
          fmt::format("M{:.1f} {:.1f}l7 7m0 -7l-7 7", b.x(curve.x_pct[i]) - 3.5, b.y(0) - 3.5);
    else
      points += fmt::format("{:.1f},{:.1f} ", b.x(curve.x_pct[i]), b.y(curve.e_deg[i]));
  return fmt::format(
      "<polyline points='{}' fill='none' stroke='{}' {}/><path d='{}' stroke='{}'/>\n", points,
      style.colour, style.more, crosses, style.colour);
}

std::string legend() {
  std::string s;
  double x = 300;
  for (const Style& style : kStyles) {
    s += fmt::format("<path d='M{} 36h26' stroke='{}' {}/><text x='{}' y='40'>{}{}</text>\n", x,
                     style.colour, style.more, x + 32, style.estimator,
                     style.below ? ", below" : "");
    x += 126;
  }
  return s;
}

}  // namespace

std::string robustness_svg(const std::vector<RobustnessCurve>& curves) {
  std::string s =
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 860 470' width='860' height='470'>\n"
      "<style>text{font:12px sans-serif}.m{text-anchor:middle}.e{text-anchor:end}"
      ".g{stroke:#e2e2e2}.z{stroke:#999}</style>\n"
      "<rect width='100%' height='100%' fill='#fff'/>\n"
      "<text x='14' y='20' style='font-weight:bold;font-size:14px'>"
      "Angle error where the filter's machine is wrong: 2000 rpm, 0.6 of rated torque</text>\n"
      "<text x='14' y='40'>mean angle error, deg; crosses: lost</text>\n";
  s += legend();
  for (int column = 0; column < 3; ++column) {
    s += axes(box_of(column, false), kParameters[column], 5);
    s += axes(box_of(column, true), kParameters[column], 20);
  }
  for (const RobustnessCurve& curve : curves) s += line(curve);
  return s + "</svg>\n";
}

}  // namespace twinrate
