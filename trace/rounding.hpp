// The errors that an encoder's counts make, drawn again.
//
// Where a count lasts many rows its error is a saw tooth, and a motion that repeats repeats it: no
// white noise. Another encoder on the same shaft, its counts 6 % narrower, makes errors of the same
// size and nearly the same spectrum that are others at each place:
//
//   phi = (1 + 0.06) theta_m/step,   error = (floor(phi) + 1/2 - phi) step
//
// Where the shaft passes nearly a whole number of counts from row to row, its error is slow, and a
// speed loop stays there. The narrower counts are passed at another rate. An encoder with the same
// counts, moved by (3 - sqrt(3))/6 of one, makes errors of the same spectrum in each part of the
// record, uncorrelated with those there:
//
//   phi = theta_m/step + 0.2113
//
// theta_m stands between the readings here: on straight lines from one change of the reading to the
// next, through a quadratic of 21 rows, within the cell that was read. For the moved counts the
// quadratic has 21 to 641 rows: the longest that stays within the cells of all its readings. Where
// none does, the place in the cell is unknown, and the narrower counts are taken. Only the draw uses
// the path; the equations use the readings.
#pragma once
#include <vector>

namespace twinrate {

// rad; `readings` stand at the centres of their cells.
std::vector<double> drawn_rounding(const std::vector<double>& readings, double lsb);
std::vector<double> moved_rounding(const std::vector<double>& readings, double lsb);
// Where the shaft may have stood.
std::vector<double> between_readings(const std::vector<double>& readings, double lsb);

}  // namespace twinrate
