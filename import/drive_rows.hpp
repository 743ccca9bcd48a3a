// A measured file as columns of a drive log: canonical names, SI units, time rising.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "import/row_reader.hpp"
#include "model/frames.hpp"

namespace twinrate {

inline constexpr std::size_t kFewestRows = 200;

struct DriveRows {
  std::string path;
  std::map<std::string, std::vector<double>> columns;  // without "t"; all of t's length
  std::vector<double> t;                               // s, strictly rising; empty: a static set
  std::vector<int> line;                               // of the file, for messages
  std::vector<std::string> left_out;  // columns of the file that nothing was taken from
  std::vector<std::string> notes;     // what was repaired or looks odd, one line each

  std::size_t size() const { return line.size(); }
  bool has(const std::string& name) const { return columns.count(name) != 0; }
  double at(const std::string& name, std::size_t row) const { return columns.at(name)[row]; }
};

// Angles come out unwrapped: by `wrap` where the map gives it, by 2 pi where the file stays within
// one turn. Throws BadInput, one line with file:line: what RowReader does, or fewer than
// kFewestRows rows. `progress` gets the share read, now and then; it may throw. Rows beyond
// `most_rows` are not read.
DriveRows read_drive_rows(const std::string& path, const ImportMap* map, bool repair,
                          const std::function<void(double)>& progress = {},
                          std::size_t most_rows = SIZE_MAX);

// A static set (flux map, inverter curve, holding currents): no time, any number of rows from
// kFewestStaticRows on; otherwise as above.
inline constexpr std::size_t kFewestStaticRows = 20;
DriveRows read_static_rows(const std::string& path, const ImportMap* map, bool repair,
                           const std::function<void(double)>& progress = {});
// False where neither the file's header nor the map knows a time. Throws as above.
bool holds_time(const std::string& path, const ImportMap* map);

// An angle that stays in less (rad) may start again at each turn.
inline constexpr double kWithinOneTurn = 1.001 * kTwoPi;
// By 2 pi where all of `theta_m` stays within one turn.
void unwrap_turns(std::vector<double>& theta_m);
// Throws BadInput at the reader's line.
[[noreturn]] void fail_too_few(const RowReader& reader, std::size_t rows, std::size_t fewest);

}  // namespace twinrate
