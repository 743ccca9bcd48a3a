// The structure of the residual after the selection, and the run that separates two causes.
#pragma once
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

// Smaller residuals (rms) of any model do not matter, however small the noise is.
double least_voltage(const DriveFacts& facts);
double least_torque(const DriveFacts& facts);

// Structure of the whitened residual: its binned means over current, speed, angle, time and
// direction, on the rows that do not judge. A structure must exceed chance and the same means of
// the drawn sensor errors. Without a claim it must also lower the error of the rows that judge,
// beyond chance, by pieces as in the gate. Beside a claim it must not raise that error. A structure
// over time has no other rows that could judge it: it is reported beside a claim, and alone it is
// not confirmed. If one mean of all rows has most of the share, that mean is reported and no axis.
// Without a claim a structure is in doubt if the sensors' errors have as much energy as the whole
// residual, or if it follows a current or the speed where the speed is constant and the angle has
// counts: the loop moves both by the counts alone. A d voltage below half of the EMF that an angle
// error of half a count makes is in doubt. If no rows judge, every fourth of 24 blocks does. Moved
// counts (trace/rounding.hpp) reproduce the slow errors at a speed that passes whole counts from
// row to row. Beside a claimed error of a current or of the angle they excuse nothing, because the
// structure may come from that error. Of the 36 logs of set A (bench/blind) that lack nothing and
// had a structure, or none for a fault, 5 have an axis left with all rules; 8 without the rule of
// the sensors, 12 without that of transfer, 11 if an axis may move by its noise alone, 26 by the
// means of fitted rows alone.
std::vector<Structure> residual_structure(const Fitter& fitter, const Fit& fit);
// The structure of a line (periodic_torque) that the selection needed.
Structure line_structure(const Effect& effect, const Selected& selected);
// The run that separates the kinds, in words.
std::string what_separates(const std::vector<std::string>& kinds);
// The same if no profile of speed, load and current separates them; empty: one does.
std::string beyond_a_run(const std::vector<std::string>& kinds);

}  // namespace twinrate
