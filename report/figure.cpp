#include "report/figure.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

namespace twinrate::report {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// m 10^-places
struct Decimal {
  std::int64_t m = 0;
  int places = 0;
};

// All that are doubles.
constexpr std::array kPowersOfTen = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                     1e8,  1e9,  1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
                                     1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

// size > 0 rounded to `digits` digits, at most 9. Empty if the rounding of one product could decide
// the result: near the middle of two decimals, and far from 1, where powers of ten are not exact.
std::optional<Decimal> decimal_of(double size, int digits) {
  constexpr double kLog10Of2 = 0.3010299956639812;
  constexpr double kNearMiddle = 1e-6;  // 2^-23 is the error of a product below 2^30
  const int exponent = static_cast<int>(std::bit_cast<std::uint64_t>(size) >> 52) - 1023;
  int places = digits - 1 - static_cast<int>(std::floor(exponent * kLog10Of2));
  const auto scaled_by = [&](int power) {
    return power < 0 ? size / kPowersOfTen[static_cast<std::size_t>(-power)]
                     : size * kPowersOfTen[static_cast<std::size_t>(power)];
  };
  if (std::abs(places) + 1 >= static_cast<int>(kPowersOfTen.size())) return {};
  if (scaled_by(places) >= kPowersOfTen[static_cast<std::size_t>(digits)]) --places;
  const double scaled = scaled_by(places);
  const auto below = static_cast<std::int64_t>(scaled);
  const double above_middle = scaled - static_cast<double>(below) - 0.5;
  if (std::abs(above_middle) < kNearMiddle) return {};
  Decimal decimal{below + (above_middle > 0), places};
  for (; decimal.m % 10 == 0; decimal.m /= 10) --decimal.places;
  return decimal;
}

void append(std::vector<std::uint8_t>& text, double value, int digits) {
  std::array<char, 32> number{};
  char* end = number.data();
  const auto put = [&](auto... what) { end = std::to_chars(end, &number.back(), what...).ptr; };
  const std::optional<Decimal> decimal =
      std::isfinite(value) && value != 0 ? decimal_of(std::abs(value), digits) : std::nullopt;
  if (!std::isfinite(value)) {
    end = std::copy_n("null", 4, end);
  } else if (!decimal) {
    put(value, std::chars_format::general, digits);
  } else {
    put(value < 0 ? -decimal->m : decimal->m);
    const auto length = end - number.data() - (value < 0);
    if (decimal->places > 0 && decimal->places < length) {
      std::copy_backward(end - decimal->places, end, end + 1);
      end[-decimal->places] = '.';
      ++end;
    } else if (decimal->places != 0) {
      *end++ = 'e';
      put(-decimal->places);
    }
  }
  const auto* const bytes = reinterpret_cast<const std::uint8_t*>(number.data());
  text.insert(text.end(), bytes, bytes + (end - number.data()));
}

// The text of a number, or of an array of them.
Json rounded(double value, int digits) {
  std::vector<std::uint8_t> text;
  append(text, value, digits);
  return Json::binary(std::move(text));
}
Json rounded(const std::vector<double>& values, int digits) {
  std::vector<std::uint8_t> text;
  text.reserve(values.size() * static_cast<std::size_t>(digits + 8));
  for (const double value : values) {
    text.push_back(text.empty() ? '[' : ',');
    append(text, value, digits);
  }
  if (text.empty()) text.push_back('[');
  text.push_back(']');
  return Json::binary(std::move(text));
}

// The smallest and the largest of value(i), i in [first, last), in their order; NaN only if all are NaN.
template <class Value>
std::pair<double, double> extremes_in_order(std::size_t first, std::size_t last,
                                            const Value& value) {
  struct Extreme {
    double value = kNaN;
    std::size_t at = 0;
  } least, greatest;
  for (std::size_t i = first; i < last; ++i) {
    const double y = value(i);
    if (!std::isfinite(y)) continue;
    if (!(y >= least.value)) least = {y, i};
    if (!(y <= greatest.value)) greatest = {y, i};
  }
  return least.at <= greatest.at ? std::pair(least.value, greatest.value)
                                 : std::pair(greatest.value, least.value);
}

// Two points a stretch: the extremes of each series, in their order, at its begin and middle. Without
// stretches there are few enough points.
struct Ticks {
  std::size_t first, last;
};
std::vector<Ticks> stretches_of(std::size_t count, std::size_t max_points) {
  std::vector<Ticks> stretches;
  if (count <= max_points) return stretches;
  const std::size_t n = max_points / 2;
  stretches.reserve(n);
  for (std::size_t s = 0; s < n; ++s) stretches.push_back({s * count / n, (s + 1) * count / n});
  return stretches;
}
template <class Value>
void thin_x(const Ticks& s, const Value& x, std::vector<double>& points) {
  points.push_back(x(s.first));
  points.push_back(x((s.first + s.last) / 2));
}
template <class Value>
void thin(const Ticks& s, const Value& value, std::vector<double>& points) {
  const auto [earlier, later] = extremes_in_order(s.first, s.last, value);
  points.push_back(earlier);
  points.push_back(later);
}

std::vector<double> thinned_x(const std::vector<double>& x, std::size_t max_points) {
  const std::vector<Ticks> stretches = stretches_of(x.size(), max_points);
  if (stretches.empty()) return x;
  std::vector<double> points;
  points.reserve(2 * stretches.size());
  for (const Ticks& s : stretches)
    thin_x(
        s, [&](std::size_t i) { return x[i]; }, points);
  return points;
}

void append(std::string& text, const Json& json) {
  const auto list = [&](char open, char close, const auto& item) {
    text += open;
    for (auto at = json.begin(); at != json.end(); ++at) {
      if (at != json.begin()) text += ',';
      item(at);
    }
    text += close;
  };
  if (json.is_binary()) {
    const std::vector<std::uint8_t>& number = json.get_binary();
    text.append(reinterpret_cast<const char*>(number.data()), number.size());
  } else if (json.is_array()) {
    list('[', ']', [&](const auto& item) { append(text, *item); });
  } else if (json.is_object()) {
    list('{', '}', [&](const auto& item) {
      append(text, Json(item.key()));
      text += ':';
      append(text, item.value());
    });
  } else {
    text += json.dump(-1, ' ', false, Json::error_handler_t::replace);
  }
}

}  // namespace

void Figure::add(Series curve) {
  const bool any = std::any_of(curve.values.begin(), curve.values.end(),
                               [](double v) { return std::isfinite(v); });
  if (any) series.push_back(std::move(curve));
}

void Figure::draw(TickRows rows, const std::vector<Curve>& curves, std::size_t max_points) {
  const std::vector<Ticks> stretches = stretches_of(rows.size(), max_points);
  const std::size_t points = stretches.empty() ? rows.size() : 2 * stretches.size();
  x.reserve(points);
  std::vector<Series> drawn;
  for (const Curve& curve : curves) {
    drawn.push_back({curve.name, curve.role, {}, curve.stepped});
    drawn.back().values.reserve(points);
  }
  const auto time = [&](std::size_t i) { return rows[i].t_s; };
  const auto of = [&](const Curve& curve) {
    return [&](std::size_t i) { return curve.quantity(rows[i]); };
  };
  for (const Ticks& s : stretches) {
    thin_x(s, time, x);
    for (std::size_t c = 0; c < curves.size(); ++c) thin(s, of(curves[c]), drawn[c].values);
  }
  for (std::size_t i = 0; stretches.empty() && i < rows.size(); ++i) {
    x.push_back(time(i));
    for (std::size_t c = 0; c < curves.size(); ++c) drawn[c].values.push_back(of(curves[c])(i));
  }
  for (Series& curve : drawn) add(std::move(curve));
}

Json to_json(const Figure& figure, std::size_t max_points) {
  Json json;
  json["title"] = figure.title;
  json["x_label"] = figure.x_label;
  json["y_label"] = figure.y_label;
  json["group"] = figure.group;
  json["note"] = figure.note;
  json["bars"] = figure.bars;
  if (figure.log_y) json["log_y"] = true;
  for (const auto& [from, to] : figure.shaded) json["shaded"].push_back(rounded({from, to}, 6));
  if (figure.y_range) json["y_range"] = rounded({figure.y_range->first, figure.y_range->second}, 5);
  for (const auto& [x, text] : figure.marks) json["marks"].push_back({{"x", x}, {"text", text}});
  if (figure.level)
    json["level"] = {{"y", rounded(figure.level->first, 5)}, {"text", figure.level->second}};
  for (const auto& [x, text] : figure.bar_labels)
    json["bar_labels"].push_back({{"x", x}, {"text", text}});
  json["x"] = rounded(thinned_x(figure.x, max_points), 9);
  json["series"] = Json::array();
  for (const Series& curve : figure.series) {
    Json one = {{"name", curve.name},
                {"role", curve.role},
                {"stepped", curve.stepped},
                {"values", rounded(thinned(curve.values, max_points), 5)}};
    if (!curve.errors.empty()) one["errors"] = rounded(curve.errors, 3);
    json["series"].push_back(std::move(one));
  }
  return json;
}

std::string text_of(const Json& json) {
  std::string text;
  append(text, json);
  return text;
}

std::vector<double> values_of(TickRows rows, const Quantity& quantity) {
  std::vector<double> values(rows.size());
  std::transform(rows.begin(), rows.end(), values.begin(), quantity);
  return values;
}

std::vector<double> thinned(const std::vector<double>& values, std::size_t max_points) {
  const std::vector<Ticks> stretches = stretches_of(values.size(), max_points);
  if (stretches.empty()) return values;
  std::vector<double> points;
  points.reserve(2 * stretches.size());
  for (const Ticks& s : stretches)
    thin(
        s, [&](std::size_t i) { return values[i]; }, points);
  return points;
}

namespace quantity {

double omega_m_true(const TickRow& row) {
  return row.truth ? row.truth->omega_m : kNaN;
}
double omega_m_measured(const TickRow& row) {
  return row.measurement && (row.measurement->signals & kSpeed) ? row.measurement->omega_m : kNaN;
}
double omega_m_hat(const TickRow& row) {
  return row.estimate ? row.estimate->omega_m : kNaN;
}
double omega_m_ref(const TickRow& row) {
  return row.command ? row.command->omega_m_ref : kNaN;
}
double T_load_true(const TickRow& row) {
  return row.truth ? row.truth->T_load : kNaN;
}
double T_load_hat(const TickRow& row) {
  return row.estimate ? row.estimate->T_load : kNaN;
}
double P44(const TickRow& row) {
  return row.gain ? row.gain->P44 : kNaN;
}
double K41(const TickRow& row) {
  return row.gain ? row.gain->K41 : kNaN;
}
double K42(const TickRow& row) {
  return row.gain ? row.gain->K42 : kNaN;
}

double theta_e_hat_deg(const TickRow& row) {
  const double theta_e = row.estimate ? row.estimate->theta_e : kNaN;
  return std::isfinite(theta_e) ? wrap_turn(theta_e) * kDegrees : kNaN;
}

Quantity theta_e_deg(AngleReference reference, int n_p) {
  return [=](const TickRow& row) {
    const double theta_e = theta_e_reference(row, reference, n_p);
    return std::isfinite(theta_e) ? wrap_turn(theta_e) * kDegrees : kNaN;
  };
}

Quantity angle_error_deg(AngleReference reference, int n_p) {
  return [=](const TickRow& row) { return angle_error(row, reference, n_p) * kDegrees; };
}

}  // namespace quantity

}  // namespace twinrate::report
