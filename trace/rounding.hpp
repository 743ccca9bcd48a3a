// Draws the rounding errors of an encoder again.
//
// If a count lasts many rows, its error is a saw tooth, and a repeated motion repeats it: it is no
// white noise. Another encoder on the same shaft, with counts 6 % narrower, makes errors of the
// same size and nearly the same spectrum, with other values at each position:
//
//   phi = (1 + 0.06) theta_m/step,   error = (floor(phi) + 1/2 - phi) step
//
// If the shaft passes nearly a whole number of counts from row to row, its error is slow, and a
// speed loop stays at such a speed. The narrower counts pass at another rate. An encoder with the
// same counts, moved by (3 - sqrt(3))/6 of a count, makes errors of the same spectrum in each part
// of the record, uncorrelated with the actual ones:
//
//   phi = theta_m/step + 0.2113
//
// theta_m is interpolated between the readings: on straight lines from one change of the reading to
// the next, through a quadratic of 21 rows, within the cell that was read. For the moved counts the
// quadratic has 21 to 641 rows: the longest that stays within the cells of all its readings. If
// none does, the position in the cell is unknown, and the narrower counts are used. Only the draw
// uses this path; the equations use the readings.
#pragma once
#include <vector>

namespace twinrate {

// rad; `readings` are at the centres of their cells.
std::vector<double> drawn_rounding(const std::vector<double>& readings, double lsb);
std::vector<double> moved_rounding(const std::vector<double>& readings, double lsb);
// An interpolated path of the shaft.
std::vector<double> between_readings(const std::vector<double>& readings, double lsb);

}  // namespace twinrate
