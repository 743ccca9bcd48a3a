// Guesses the map of a foreign file from its header and its first rows.
//
// A column is understood if its name, with its unit, has one meaning in drive logs. All other
// columns are left out of the map, with the reason: a column that is not understood costs a line of
// the map, a column that is understood wrongly costs a result. The unit comes from brackets ("Iq
// [mA]"), from the end of the name ("iq_mA"), from a row of units below the header, or from the
// tool that wrote the file. Without any of these the values decide if possible (see `unit_from`),
// and this is reported.
//
//   current, voltage   A and V if the values are small and have three or more decimals
//   time               s if the rows are 1 us to 20 ms apart: in ms they would be below 20 us
//   angle              rad or deg if the values fill one turn and restart
//   speed, torque      never
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "import/map.hpp"

namespace twinrate {

// Logs of known tools: "" none, else one of known_tools().
const std::vector<std::string>& known_tools();

struct GuessedColumn {
  std::string name;       // in the file
  int number = 0;         // from 1
  std::string canonical;  // "t" for the time; empty: not understood
  double scale = 1, offset = 0, wrap = 0;
  std::string unit_from;  // source of the unit
  std::string reason;     // why it is not understood
};

struct Guess {
  std::string path, tool;
  CsvFormat format;
  bool numbered = false;  // the map has column numbers: the reader cannot take the names
  std::vector<GuessedColumn> columns;
  std::vector<std::string> notes;

  bool has(const std::string& canonical) const;
};

struct GuessRequest {
  std::string file;
  std::string tool;        // "": recognised by the header
  std::optional<int> n_p;  // of the drive, for electrical speeds
};

// Throws BadInput: no such file, no table in its first lines, another tool's file.
Guess guess_map(const GuessRequest& request);

// The map file (map.hpp), with columns that are not understood as comments. `preset`: of [drive],
// or "".
std::string map_toml(const Guess& guess, const std::string& preset);

}  // namespace twinrate
