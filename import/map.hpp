// How a foreign file's columns become a drive log's: the map file of `twinrate import`.
//
//   [columns]
//   i_q     = { from = "Iq", scale = 1.0, offset = 0.0 }          value = scale * raw + offset, SI
//   theta_m = { from = "enc", wrap = 65536, scale = 9.587e-5 }    the raw unit restarts at `wrap`
//   omega_m = "Velocity"                                          short form
//   v_dc    = { from = 3 }                                        the third column
//
//   [time]
//   from = "Time", unit = "s" | "ms" | "us" | "ns", scale, offset
//
//   [file]
//   separator = "," (";" "\t" " "), decimal = ".", skip = 0, comment = "#", header = true
//
//   [drive]
//   preset = "laas_mn4004"
#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "import/csv.hpp"

namespace twinrate {

struct ColumnMap {
  std::string from;  // column name; empty where `number` is given
  int number = 0;    // column number, from 1
  double scale = 1, offset = 0;
  double wrap = 0;    // raw period of an angle, 0: none
  std::string where;  // file:line of the map, empty without one
};

struct ImportMap {
  CsvFormat format;
  std::map<std::string, ColumnMap> columns;  // by canonical name, "t" among them
  std::string preset, preset_where;          // empty: not given; file:line of it
  std::string toml;                          // the map's own text, empty where there is none
  bool time_given = false;                   // by [time] or columns.t
};

// Every canonical column name of a drive log, in the order of the contracts.
const std::vector<std::string>& canonical_columns();
// Further names that only static sets have.
const std::vector<std::string>& static_columns();

// Throws BadInput: no such file, not TOML, unknown key or column, wrong value.
ImportMap read_import_map(const std::string& path);
// For a file whose header holds canonical names; columns that are not canonical are left out.
ImportMap canonical_map(const std::vector<std::string>& header);

}  // namespace twinrate
