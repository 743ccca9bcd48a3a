// Figures for report.js, as JSON: named series over one time (or order) axis.
//
// Long series are thinned to kMaxPoints: the extremes of equal stretches of ticks, so that peaks
// stay, as they are taken from the ticks or, of other values, when the figure is written. All series of a figure have the same axis. Values have five significant digits; NaN and
// infinity are null (a gap).
#pragma once
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "analysis/summary.hpp"

namespace twinrate::report {

using Json = nlohmann::ordered_json;
inline constexpr std::size_t kMaxPoints = 9000;
inline constexpr double kDegrees = 180 / kPi;

// One curve. `role` chooses colour and stroke in report.js: true, hat, ref, true2, hat2, ref2, run0
// .. run7; dots, dots2: points without a line.
struct Series {
  std::string name, role;
  std::vector<double> values;
  bool stepped = false;
  std::vector<double> errors = {};  // half-length of each point's error bar; not thinned
};

// A curve over the time of ticks.
using Quantity = std::function<double(const TickRow&)>;
struct Curve {
  std::string name, role;
  Quantity quantity;
  bool stepped = false;
};

struct Figure {
  std::string title, x_label, y_label;
  std::vector<double> x;
  std::vector<Series> series;
  std::string group;  // figures of one group share cursor and zoom
  std::string note;   // one line under the figure
  std::optional<std::pair<double, double>> y_range;
  std::vector<std::pair<double, std::string>> marks;    // vertical lines with labels
  std::optional<std::pair<double, std::string>> level;  // a horizontal line with its label
  std::vector<std::pair<double, double>> shaded = {};   // shaded intervals of x
  bool log_y = false;
  bool bars = false;  // a spectrum; without bar_labels the largest bars show their x
  std::vector<std::pair<double, std::string>> bar_labels;

  // Adds the curve if a value is finite.
  void add(Series curve);
  // Draws the curves over t: x and the values, thinned in one pass, so that a long run is neither
  // copied nor read curve by curve.
  void draw(TickRows rows, const std::vector<Curve>& curves, std::size_t max_points = kMaxPoints);
  bool empty() const { return series.empty(); }
};

// Numbers that are drawn are Json::binary, their text: thousands of them as values of their own would
// be most of the time of a page. text_of() writes them.
Json to_json(const Figure& figure, std::size_t max_points = kMaxPoints);
// One line of JSON.
std::string text_of(const Json& json);

// values[i] = quantity(rows[i]).
std::vector<double> values_of(TickRows rows, const Quantity& quantity);
std::vector<double> thinned(const std::vector<double>& values, std::size_t max_points);

// The quantities of a tick; NaN if the log does not hold them. Angles are wrapped into [0, 360);
// angles and angle errors in degrees.
namespace quantity {
double omega_m_true(const TickRow& row);
double omega_m_measured(const TickRow& row);
double omega_m_hat(const TickRow& row);
double omega_m_ref(const TickRow& row);
double T_load_true(const TickRow& row);
double T_load_hat(const TickRow& row);
double P44(const TickRow& row);
double K41(const TickRow& row);
double K42(const TickRow& row);
double theta_e_hat_deg(const TickRow& row);
Quantity theta_e_deg(AngleReference reference, int n_p);
Quantity angle_error_deg(AngleReference reference, int n_p);
}  // namespace quantity

}  // namespace twinrate::report
