// The map file of `twinrate import`: columns of a foreign file -> columns of a drive log.
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
//   [axis]
//   travel_m = 0.03                 of a linear axis in one turn of theta_m
//
//   [drive]
//   preset = "laas_mn4004"
//
// A linear axis has x, v, force, force_ref instead of theta_m, omega_m, torque, torque_ref. They are
// read as those of the rotary machine that moves the axis at the radius r = travel_m/(2 pi):
//
//   theta_m = x/r   omega_m = v/r   torque = r force   torque_ref = r force_ref
//
// Without travel_m r is 1 m: one rad is one metre, one Nm one newton, one kgm2 one kilogram.
#pragma once
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "import/csv.hpp"

namespace twinrate {

struct ColumnMap {
  std::string from;  // column name; empty if `number` is given
  int number = 0;    // column number, from 1
  double scale = 1, offset = 0;
  double wrap = 0;    // period of a raw angle; 0: none
  bool turns = true;  // false: a position of a linear axis, which does not restart
  std::string where;  // file:line of the map; empty without a map
};

struct ImportMap {
  CsvFormat format;
  std::map<std::string, ColumnMap> columns;  // by canonical name, "t" included
  std::string preset, preset_where;          // name and file:line; empty: not given
  std::string toml;                          // text of the map file; empty without one
  bool time_given = false;                   // by [time] or columns.t
  std::vector<std::string> linear;           // the columns of a linear axis, by their own names
  double radius_m = 1;                       // of that axis

  // True if a jump of theta_m in the file may be the start of a new turn.
  bool may_wrap() const;
};

// Every canonical column name of a drive log, in the order of the contracts.
const std::vector<std::string>& canonical_columns();
// Additional column names of static sets, and those of a linear axis.
const std::vector<std::string>& static_columns();
const std::vector<std::string>& linear_columns();

// Throws BadInput: no such file, not TOML, unknown key or column, wrong value.
ImportMap read_import_map(const std::string& path);
// The map of a header with canonical names; other columns are ignored, and so are those of a linear
// axis beside an angle, a speed or a torque.
ImportMap canonical_map(const std::vector<std::string>& header);

}  // namespace twinrate
