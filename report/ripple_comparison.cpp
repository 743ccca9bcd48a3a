// Comparison of runs: the shape of the estimated load over the angle, and the ripple before and
// after a change of the compensation.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "report/ripple.hpp"

namespace twinrate::report {
namespace {

constexpr std::size_t kMaxOverlaid = 4;
constexpr int kGridPoints = 1440;

struct Shape {
  std::string name;
  OrderSpectrum spectrum;
};

// Shapes of the runs with a varying load estimate, of the filter and compensation of the first run:
// another method changes the shape.
std::vector<Shape> shapes_of(const std::vector<RunView>& views,
                             const std::vector<std::string>& names) {
  std::vector<Shape> shapes;
  const auto method = [](const RunView& view) {
    const DriveConfig& config = view.run.config;
    return std::pair(config.estimator.kind, config.controller.compensation_at(view.end_s()));
  };
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].lost() || method(views[i]) != method(views.front())) continue;
    Shape shape{names[i], torque_over_angle(views[i], kRippleOrders).spectrum};
    if (shape.spectrum.turns > 0 && shape.spectrum.rms(kRippleOrders) > 0) shapes.push_back(shape);
  }
  return shapes;
}

Figure shape_figure(const std::vector<Shape>& shapes) {
  Figure figure{.title = "T_load_hat over the angle, without its mean",
                .x_label = "angle of the rotor (deg)",
                .y_label = "T_load_hat (Nm)"};
  for (int i = 0; i <= kGridPoints; ++i) figure.x.push_back(360.0 * i / kGridPoints);
  for (std::size_t s = 0; s < std::min(shapes.size(), kMaxOverlaid); ++s) {
    Series curve{shapes[s].name, fmt::format("run{}", s), {}};
    for (const double angle_deg : figure.x)
      curve.values.push_back(shapes[s].spectrum.at(angle_deg / kDegrees, kRippleOrders));
    figure.add(curve);
  }
  figure.note = "Orders 1 to 60, averaged over the last whole turns of each run.";
  return figure;
}

// The correlation, and the largest correlation over a shift of the angle if it is larger by more
// than 0.01: the lag of a filter is an angle that grows with the speed.
std::string correlation_cell(const Shape& a, const Shape& b) {
  const double plain = shape_correlation(a.spectrum, b.spectrum, kRippleOrders);
  constexpr double kStep_deg = 0.05, kMaxShift_deg = 10;
  double best = plain, best_deg = 0;
  for (double turned_deg = -kMaxShift_deg; turned_deg <= kMaxShift_deg; turned_deg += kStep_deg) {
    const double turned =
        shape_correlation(a.spectrum, b.spectrum, kRippleOrders, turned_deg / kDegrees);
    if (turned > best) best = turned, best_deg = turned_deg;
  }
  if (best < plain + 0.01) return fmt::format("{:.3f}", plain);
  return fmt::format("{:.3f}; {:.3f} turned by {:.1f} deg", plain, best, best_deg);
}

Json correlation_table(const std::vector<Shape>& shapes) {
  Json head = {"correlation"}, rows = Json::array();
  for (const Shape& column : shapes) head.push_back(column.name);
  for (const Shape& row : shapes) {
    Json cells = {row.name};
    for (const Shape& column : shapes) cells.push_back(correlation_cell(row, column));
    rows.push_back(cells);
  }
  return {{"head", head}, {"rows", rows}};
}

}  // namespace

Json shape_section(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  const std::vector<Shape> shapes = shapes_of(views, names);
  Json figures = Json::array();
  if (shapes.size() > 1) figures.push_back(to_json(shape_figure(shapes)));
  return {
      {"heading", "Estimated load over the angle"},
      {"note",
       "An effect of the motor keeps its shape over the angle at every speed: coefficients "
       "near 1. The lag of the filter shifts the shape as the speed grows. Runs with the filter "
       "and compensation of the first run."},
      {"columns", 1},
      {"figures", figures},
      {"table", correlation_table(shapes)}};
}

Json reduction_section(const std::vector<RunView>& views, const std::vector<std::string>& names) {
  Json rows = Json::array(), figures = Json::array();
  for (std::size_t i = 0; i < views.size(); ++i) {
    if (views[i].lost() || views[i].rows.empty()) continue;
    const std::vector<Stretch> stretches = ripple_stretches(views[i]);
    if (stretches.size() < 2) continue;
    const Stretch &first = stretches.front(), &last = stretches.back();
    const double orders_before = first.spectrum.rms(kRippleOrders),
                 orders_after = last.spectrum.rms(kRippleOrders);
    rows.push_back({names[i], first.compensation + " to " + last.compensation,
                    fmt::format("{:.4g}", first.rms), fmt::format("{:.4g}", last.rms),
                    change_dB(first.rms, last.rms), fmt::format("{:.4g}", orders_before),
                    fmt::format("{:.4g}", orders_after), change_dB(orders_before, orders_after)});
    Figure figure = speed_figure(views[i], views[i].between(first.from_s, views[i].end_s()), 3000);
    figure.title = names[i];
    figure.marks = {{last.begin_s, last.compensation}};
    figures.push_back(to_json(figure));
  }
  return {{"heading", "Speed ripple before and after"},
          {"note", "Over the last whole turns of the first and of the last stretch of each run."},
          {"columns", 2},
          {"figures", figures},
          {"table",
           {{"head",
             {"run", "compensation", "before, rad/s rms", "after", "change", "orders 1-60 before",
              "after", "change"}},
            {"rows", rows}}}};
}

}  // namespace twinrate::report
