// A table of text of unknown layout: separator, decimal sign, header and the first rows.
#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace twinrate {

struct Layout {
  char separator = ',', decimal = '.';
  std::size_t data_line = 0, fields = 0, numbers = 0;  // numbers: fields that are numbers
};

// Values of the first rows.
struct Values {
  std::vector<double> x;
  int decimals = 0;  // most digits behind the decimal point

  double max_abs() const {
    double max = 0;
    for (const double v : x) max = std::max(max, std::abs(v));
    return max;
  }
  double median_step() const {
    std::vector<double> steps;
    for (std::size_t i = 1; i < x.size(); ++i) steps.push_back(x[i] - x[i - 1]);
    if (steps.empty()) return 0;
    const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
    std::nth_element(steps.begin(), middle, steps.end());
    return *middle;
  }
  // The values fill 0 to `turn` (or -turn/2 to turn/2) and jump back by almost a turn.
  bool restarts_at(double turn) const {
    if (x.empty()) return false;
    const auto [low, high] = std::minmax_element(x.begin(), x.end());
    bool jump = false;
    for (std::size_t i = 1; i < x.size(); ++i)
      jump = jump || std::abs(x[i] - x[i - 1]) > 0.8 * turn;
    const double range = *high - *low;
    return jump && range > 0.9 * turn && range <= 1.001 * turn;
  }
};

struct Header {
  std::vector<std::string> names, units;
  bool by_number = false;
  std::size_t skip = 0;
};

// Of the first 256 KiB of a file, unpacked; without the last line if it is cut.
std::vector<std::string> first_lines(const std::string& path);
// The layout with the most numbers a row. Throws BadInput: no table.
Layout best_layout(const std::string& path, const std::vector<std::string>& lines);
// The numbers of a column in these lines.
Values values_of(const std::vector<std::string>& lines, const Layout& layout, std::size_t column);
// Names and units above the data.
Header header_of(const std::vector<std::string>& lines, const Layout& layout);
// The map is UTF-8, the names of the file may be Latin 1: true if a name or a unit was changed. The map then has the
// numbers of the columns.
bool make_utf8(Header& header);

}  // namespace twinrate
