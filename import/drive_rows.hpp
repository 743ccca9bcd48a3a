// A measured file as columns of a drive log: canonical names, SI units, rising time.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "import/row_reader.hpp"
#include "model/frames.hpp"

namespace twinrate {

inline constexpr std::size_t kMinRows = 200;

struct DriveRows {
  std::string path;
  std::map<std::string, std::vector<double>> columns;  // without "t"; all of t's length
  std::vector<double> t;                               // s, strictly rising; empty: a static set
  std::vector<int> line;                               // of the file, for messages
  std::vector<std::string> left_out;                   // unused columns of the file
  std::vector<std::string> notes;                      // repairs and suspect values, one line each

  std::size_t size() const { return line.size(); }
  bool has(const std::string& name) const { return columns.count(name) != 0; }
  double at(const std::string& name, std::size_t row) const { return columns.at(name)[row]; }
};

// Angles are unwrapped: with `wrap` of the map, or with 2 pi if the file stays within one turn.
// Throws BadInput, one line with file:line: as RowReader, or fewer than kMinRows rows. `progress`
// gets the share read; it may throw. At most `max_rows` rows are read.
DriveRows read_drive_rows(const std::string& path, const ImportMap* map, bool repair,
                          const std::function<void(double)>& progress = {},
                          std::size_t max_rows = SIZE_MAX);

// A static set (flux map, inverter curve, holding currents): no time, at least kMinStaticRows rows;
// otherwise as above.
inline constexpr std::size_t kMinStaticRows = 20;
DriveRows read_static_rows(const std::string& path, const ImportMap* map, bool repair,
                           const std::function<void(double)>& progress = {});
// False if neither the file's header nor the map has a time column. Throws as above.
bool holds_time(const std::string& path, const ImportMap* map);

// An angle with a smaller range may wrap at each turn.
inline constexpr double kOneTurnRange_rad = 1.001 * kTwoPi;
// Unwraps by 2 pi if the range of `theta_m` is at most kOneTurnRange_rad.
void unwrap_turns(std::vector<double>& theta_m);
// Throws BadInput at the reader's line.
[[noreturn]] void fail_too_few(const RowReader& reader, std::size_t rows, std::size_t min_rows);

}  // namespace twinrate
