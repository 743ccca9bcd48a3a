// The steps of a sensor, found in its readings.
//
// An encoder is a counter: it rounds down, so a reading is at the low end of its cell, as with the
// simulated encoder (model/sensors.hpp). The tracer takes every reading as the centre of its cell.
// At the low end the angle would lag by half a count, and an offset, an inductance or a saturation
// would explain that lag.
#pragma once
#include <cstddef>
#include <optional>
#include <unordered_set>
#include <vector>

#include "trace/decimals.hpp"

namespace twinrate {

struct Sensor {
  double lsb = 0;     // step between readings; 0: none that matters
  double centre = 0;  // of a cell, relative to its reading
  double moved = 0;   // added to the readings, whose zero within a step is not known

  int counts() const;  // a turn, of an angle; 0: no steps
};

// The steps of an angle, in rad, from its readings in the order of time. Encoders of 2^18 counts
// and more have no steps that matter: half a count is 12 urad there. `declared`: counts a turn of
// the drive file, 0 if it has none. A step that the readings show has priority. If the rotor turns
// by about one count a row all the time, the steps look like those of a clock and are not detected.
// Readings on the grid of the declared encoder are then taken as its counts.
class AngleSteps {
 public:
  explicit AngleSteps(int declared = 0) : declared_(declared) {}
  void add(double theta_m);
  Sensor sensor() const;

 private:
  // `readings`: sorted, within a turn. `same`: rad, change of a reading by the digits of the file.
  Sensor found_in(const std::vector<double>& readings, double same) const;

  int declared_;
  std::unordered_set<long long> readings_;  // within a turn, by tenths of a urad
  bool few_ = true;                         // few enough for a counter
  std::optional<double> last_, before_;
  std::size_t moves_ = 0, bends_ = 0;  // rows
  double way_ = 0;                     // rad, of all rows that move
  std::vector<double> ways_;           // rad, of the first windows
  double way_of_window_ = 0;           // rad
  std::size_t rows_of_window_ = 0;
  std::vector<double> first_bends_;  // rad
  Decimals decimals_;
};

}  // namespace twinrate
