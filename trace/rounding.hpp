// The errors that an encoder's counts make, drawn again.
//
// Where a count lasts many rows its error is a saw tooth, and a motion that repeats repeats it: no
// white noise. Another encoder on the same shaft, its counts 6 % narrower, makes errors of the same
// size and nearly the same spectrum that are others at each place:
//
//   phi = (1 + 0.06) theta_m/step,   error = (floor(phi) + 1/2 - phi) step
//
// theta_m stands between the readings here: on straight lines from one change of the reading to the
// next, through a quadratic of 21 rows, within the cell that was read. Only the draw uses it; the
// equations use the readings.
#pragma once
#include <vector>

namespace twinrate {

// rad; `readings` stand at the centres of their cells.
std::vector<double> drawn_rounding(const std::vector<double>& readings, double lsb);
// Where the shaft may have stood.
std::vector<double> between_readings(const std::vector<double>& readings, double lsb);

}  // namespace twinrate
