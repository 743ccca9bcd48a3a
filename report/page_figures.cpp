#include "report/page_figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/config.hpp"

namespace twinrate::report {
namespace {

using Json = nlohmann::json;

constexpr double kWidth = 860, kHeight = 330, kLeft = 84, kRight = 16, kTop = 56, kBottom = 74;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr std::size_t kLabelledBars = 8;

// Strokes of report.js.
struct Stroke {
  const char *role, *colour, *width, *dash;
  bool dots;
};
constexpr Stroke kStrokes[] = {
    {"true", "#b4bcc4", "3.5", "", false},   {"hat", "#0b5cab", "1.3", "", false},
    {"ref", "#1c2126", "1.2", "6 4", false}, {"true2", "#f0c9a4", "3.5", "", false},
    {"hat2", "#c2500a", "1.3", "", false},   {"ref2", "#7a3d12", "1.2", "2 3", false},
    {"lost", "#b3261e", "1.1", "", false},   {"fit", "#1c2126", "2", "", false},
    {"dots0", "#b4bcc4", "0", "", true},     {"dots", "#0b5cab", "0", "", true},
    {"dots2", "#e07b1a", "0", "", true},     {"run0", "#0b5cab", "1.5", "", false},
    {"run1", "#c2500a", "1.5", "", false},   {"run2", "#1d7a46", "1.5", "", false},
    {"run3", "#7b3fa0", "1.5", "", false}};

const Stroke& stroke_of(const std::string& role) {
  for (const Stroke& stroke : kStrokes)
    if (role == stroke.role) return stroke;
  return kStrokes[1];
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else
      out += c;
  }
  return out;
}

std::string text_at(double x, double y, const std::string& words, const std::string& more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\"{}>{}</text>\n", x, y, more, escaped(words));
}

double number(const Json& value) {
  return value.is_number() ? value.get<double>() : kNone;
}
std::vector<double> numbers(const Json& values) {
  std::vector<double> list;
  for (const Json& value : values) list.push_back(number(value));
  return list;
}

struct Axis {
  double lo = 0, hi = 1, from = 0, to = 1;
  bool log = false;

  double at(double value) const {
    if (log && !(value > 0)) return kNone;
    const double place = log ? std::log(value / lo) / std::log(hi / lo) : (value - lo) / (hi - lo);
    return from + place * (to - from);
  }
  std::vector<double> ticks() const {
    std::vector<double> list;
    if (log) {
      for (double value = std::pow(10, std::ceil(std::log10(lo))); value <= hi; value *= 10)
        list.push_back(value);
      return list;
    }
    const double raw = (hi - lo) / 6, decade = std::pow(10, std::floor(std::log10(raw)));
    const double share = raw / decade, step = decade * (share < 1.5   ? 1
                                                        : share < 3.5 ? 2
                                                        : share < 7.5 ? 5
                                                                      : 10);
    for (double value = std::ceil(lo / step) * step; value <= hi + 1e-9 * step; value += step)
      list.push_back(std::abs(value) < 1e-9 * step ? 0 : value);
    return list;
  }
};

class Drawing {
 public:
  explicit Drawing(const Json& figure) : figure_(figure), x_(numbers(figure.at("x"))) {
    bars_ = figure.value("bars", false);
    choose_ranges();
  }

  std::string text() const {
    std::string out = axes();
    for (const Json& part : figure_.value("shaded", Json::array())) {
      const double from = std::max(number(part.at(0)), across_.lo),
                   to = std::min(number(part.at(1)), across_.hi);
      if (to > from)
        out += fmt::format(
            "<rect x=\"{:.1f}\" y=\"{}\" width=\"{:.1f}\" height=\"{}\" fill=\"#fdf1e2\"/>\n",
            across_.at(from), kTop, across_.at(to) - across_.at(from), kHeight - kBottom - kTop);
    }
    double legend = kLeft;
    for (const Json& series : figure_.at("series")) {
      const Stroke& stroke = stroke_of(series.value("role", ""));
      const std::vector<double> y = numbers(series.at("values"));
      out += bars_ ? bars(y, stroke) : stroke.dots ? dots(y, stroke) : line(y, stroke, series);
      if (series.contains("errors")) out += errors(y, numbers(series["errors"]), stroke);
      const std::string name = series.value("name", "");
      if (name.empty()) continue;
      out += text_at(legend, kTop - 8, name, fmt::format(" fill=\"{}\"", stroke.colour));
      legend += 7.0 * static_cast<double>(name.size()) + 14;
    }
    return out + marks();
  }

 private:
  void choose_ranges() {
    across_ = {.lo = 1e300, .hi = -1e300, .from = kLeft, .to = kWidth - kRight};
    up_ = {.lo = 1e300,
           .hi = -1e300,
           .from = kHeight - kBottom,
           .to = kTop,
           .log = figure_.value("log_y", false)};
    for (const double x : x_)
      if (std::isfinite(x))
        across_.lo = std::min(across_.lo, x), across_.hi = std::max(across_.hi, x);
    for (const Json& series : figure_.at("series"))
      for (const double y : numbers(series.at("values")))
        if (std::isfinite(y) && (!up_.log || y > 0))
          up_.lo = std::min(up_.lo, y), up_.hi = std::max(up_.hi, y);
    if (across_.lo > across_.hi) across_.lo = 0, across_.hi = 1;
    if (bars_) across_.lo -= 0.7, across_.hi += 0.7;
    if (across_.hi <= across_.lo) across_.hi = across_.lo + 1;
    if (figure_.contains("y_range")) {
      up_.lo = number(figure_["y_range"].at(0));
      up_.hi = number(figure_["y_range"].at(1));
    } else if (up_.lo > up_.hi) {
      up_.lo = up_.log ? 1e-6 : 0, up_.hi = 1;
    } else if (up_.log) {
      up_.lo /= 1.3, up_.hi *= 1.6;
    } else if (bars_) {
      up_.lo = 0, up_.hi = up_.hi > 0 ? (figure_.contains("bar_labels") ? 2.2 : 1.15) * up_.hi : 1;
    } else {
      const double size = std::max(std::abs(up_.lo), std::abs(up_.hi)),
                   margin = std::max(0.06 * (up_.hi - up_.lo), 1e-9 + 0.01 * size);
      up_.lo -= margin, up_.hi += margin;
    }
  }

  std::string axes() const {
    std::string out;
    for (const double y : up_.ticks()) {
      out += fmt::format("<path class=\"g\" d=\"M{} {:.1f}H{}\"/>\n", kLeft, up_.at(y),
                         kWidth - kRight);
      out += text_at(kLeft - 6, up_.at(y) + 4, fmt::format("{:.6g}", y), " text-anchor=\"end\"");
    }
    for (const double x : across_.ticks())
      out += text_at(across_.at(x), kHeight - kBottom + 16, fmt::format("{:.6g}", x),
                     " text-anchor=\"middle\"");
    out += fmt::format("<path class=\"a\" d=\"M{0} {1}V{2}H{3}\"/>\n", kLeft, kTop,
                       kHeight - kBottom, kWidth - kRight);
    out += text_at(kWidth - kRight, kHeight - kBottom + 32, figure_.value("x_label", ""),
                   " text-anchor=\"end\"");
    return out + text_at(14, 0.5 * (kTop + kHeight - kBottom), figure_.value("y_label", ""),
                         fmt::format(" text-anchor=\"middle\" transform=\"rotate(-90 14 {})\"",
                                     0.5 * (kTop + kHeight - kBottom)));
  }

  // A missing value is a gap.
  std::string line(const std::vector<double>& y, const Stroke& stroke, const Json& series) const {
    std::string path;
    bool pen = false;
    const bool stepped = series.value("stepped", false),
               across_gaps = figure_.value("group", "") == "overlay";
    for (std::size_t i = 0; i < std::min(x_.size(), y.size()); ++i) {
      const double at_x = across_.at(x_[i]), at_y = up_.at(y[i]);
      if (!std::isfinite(at_y)) {
        pen = pen && across_gaps;
        continue;
      }
      path += !pen      ? fmt::format("M{:.1f} {:.1f}", at_x, at_y)
              : stepped ? fmt::format("H{:.1f}V{:.1f}", at_x, at_y)
                        : fmt::format("L{:.1f} {:.1f}", at_x, at_y);
      pen = true;
    }
    return fmt::format(
        "<path class=\"c\" d=\"{}\" stroke=\"{}\" stroke-width=\"{}\" stroke-dasharray=\"{}\"/>\n",
        path, stroke.colour, stroke.width, *stroke.dash ? stroke.dash : "none");
  }
  std::string dots(const std::vector<double>& y, const Stroke& stroke) const {
    std::string path;
    for (std::size_t i = 0; i < std::min(x_.size(), y.size()); ++i)
      if (std::isfinite(up_.at(y[i])))
        path += fmt::format("M{:.1f} {:.1f}h0", across_.at(x_[i]), up_.at(y[i]));
    return fmt::format(
        "<path class=\"c\" d=\"{}\" stroke=\"{}\" stroke-width=\"5\" stroke-linecap=\"round\"/>\n",
        path, stroke.colour);
  }
  std::string errors(const std::vector<double>& y, const std::vector<double>& sizes,
                     const Stroke& stroke) const {
    std::string path;
    for (std::size_t i = 0; i < std::min({x_.size(), y.size(), sizes.size()}); ++i)
      if (std::isfinite(up_.at(y[i] - sizes[i])) && std::isfinite(up_.at(y[i] + sizes[i])))
        path += fmt::format("M{:.1f} {:.1f}V{:.1f}", across_.at(x_[i]), up_.at(y[i] - sizes[i]),
                            up_.at(y[i] + sizes[i]));
    return fmt::format("<path class=\"c\" d=\"{}\" stroke=\"{}\"/>\n", path, stroke.colour);
  }
  std::string bars(const std::vector<double>& y, const Stroke& stroke) const {
    std::string path, labels;
    double largest = 0;
    for (const double value : y)
      if (std::isfinite(value)) largest = std::max(largest, value);
    std::vector<std::size_t> by_size;
    for (std::size_t i = 0; i < std::min(x_.size(), y.size()); ++i) {
      if (!std::isfinite(y[i])) continue;
      path += fmt::format("M{:.1f} {}V{:.1f}", across_.at(x_[i]), kHeight - kBottom, up_.at(y[i]));
      if (y[i] > 0.04 * largest) by_size.push_back(i);
    }
    std::sort(by_size.begin(), by_size.end(),
              [&](std::size_t a, std::size_t b) { return y[a] > y[b]; });
    by_size.resize(std::min(by_size.size(), kLabelledBars));
    const Json given = figure_.value("bar_labels", Json::array());
    for (const Json& label : given) {
      const auto i = static_cast<std::size_t>(
          std::find(x_.begin(), x_.end(), number(label.at("x"))) - x_.begin());
      if (i >= y.size() || !std::isfinite(y[i])) continue;
      const double at_x = across_.at(x_[i]) + 4, at_y = up_.at(y[i]) - 5;
      labels += text_at(at_x, at_y, label.at("text").get<std::string>(),
                        fmt::format(" transform=\"rotate(-90 {:.1f} {:.1f})\"", at_x, at_y));
    }
    if (given.empty())
      for (const std::size_t i : by_size)
        labels += text_at(across_.at(x_[i]), up_.at(y[i]) - 4, fmt::format("{:g}", x_[i]),
                          " text-anchor=\"middle\"");
    const double width =
        std::min(40.0, 0.6 * (kWidth - kLeft - kRight) / static_cast<double>(x_.size() + 1));
    return fmt::format("<path d=\"{}\" stroke=\"{}\" stroke-width=\"{:.1f}\"/>\n", path,
                       stroke.colour, std::max(width, 1.0)) +
           labels;
  }
  std::string marks() const {
    std::string out;
    for (const Json& mark : figure_.value("marks", Json::array())) {
      const double at = across_.at(number(mark.at("x")));
      if (!(at >= kLeft && at <= kWidth - kRight)) continue;
      out += fmt::format("<path class=\"m\" d=\"M{:.1f} {}V{}\"/>\n", at, kTop, kHeight - kBottom);
      out += text_at(at + 4, kTop + 12, mark.value("text", ""));
    }
    if (figure_.contains("level")) {
      const double at = up_.at(number(figure_["level"].at("y")));
      if (at <= kHeight - kBottom && at >= kTop) {
        out += fmt::format("<path class=\"m\" d=\"M{} {:.1f}H{}\"/>\n", kLeft, at, kWidth - kRight);
        out += text_at(kLeft + 4, at - 4, figure_["level"].value("text", ""));
      }
    }
    return out;
  }

  const Json& figure_;
  std::vector<double> x_;
  bool bars_ = false;
  Axis across_, up_;
};

std::string drawn(const Json& figure, const std::string& caption) {
  const std::string note = figure.value("note", "");
  return fmt::format(
             "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" "
             "height=\"{1}\" font-family=\"sans-serif\" font-size=\"12\" fill=\"#1c2126\">\n"
             "<style>.c{{fill:none}}.g{{stroke:#e4e4e4}}.a{{stroke:#888;fill:none}}"
             ".m{{stroke:#888;stroke-dasharray:4 3}}</style>\n"
             "<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
             kWidth, kHeight) +
         text_at(10, 22, figure.value("title", ""), " font-size=\"15\" font-weight=\"bold\"") +
         Drawing(figure).text() + text_at(10, kHeight - 24, note, " fill=\"#555\"") +
         text_at(10, kHeight - 8, caption, " fill=\"#555\"") + "</svg>\n";
}

// "03-angle-error"
std::string file_name(std::size_t number, const std::string& title) {
  std::string name = fmt::format("{:02}-", number);
  for (const char c : title) {
    const bool letter = std::isalnum(static_cast<unsigned char>(c)) != 0;
    if (letter)
      name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    else if (name.back() != '-')
      name += '-';
    if (name.size() > 60) break;
  }
  while (name.back() == '-') name.pop_back();
  return name;
}

}  // namespace

std::vector<PageFigure> figures_of_page(const std::string& path, const std::string& command) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw BadInput(fmt::format("{}: no such file", path));
  const std::string html{std::istreambuf_iterator<char>(in), {}};
  const std::string open = "<script type=\"application/json\" id=\"content\">";
  const std::size_t at = html.find(open), end = html.find("</script>", at);
  const Json page =
      at == std::string::npos || end == std::string::npos
          ? Json()
          : Json::parse(html.substr(at + open.size(), end - at - open.size()), nullptr, false);
  if (!page.is_object() || !page.contains("sections"))
    throw BadInput(fmt::format("{}: not a page of twinrate report or trace", path));
  std::vector<PageFigure> figures;
  try {
    const std::string caption = page.value("title", "") + ". " + page.value("command", command);
    for (const Json& section : page["sections"])
      for (const Json& figure : section.value("figures", Json::array()))
        figures.push_back({file_name(figures.size() + 1, figure.value("title", "figure")),
                           drawn(figure, caption)});
  } catch (const Json::exception&) {
    throw BadInput(fmt::format("{}: its figures are not those of this program", path));
  }
  if (figures.empty()) throw BadInput(fmt::format("{}: no figure in the page", path));
  return figures;
}

}  // namespace twinrate::report
