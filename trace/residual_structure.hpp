// The structure of the residual after the selection, and the run that separates two causes.
#pragma once
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

// Less rms is left of any model: no rest of it matters, however small the noise is.
double least_voltage(const DriveFacts& facts);
double least_torque(const DriveFacts& facts);

// Binned means of the whitened residual over current, speed, angle, time and direction, of the rows
// that do not judge, where they are beyond chance and beyond what the same means say of the sensors'
// drawn errors. Where nothing is claimed they must lower the error of the rows that judge, too,
// beyond chance, by pieces as in the gate; beside a claim it is enough that they do not raise it.
// Those over time, of which no other rows are there, are told beside a claim, and not confirmed alone.
// Where one mean for all rows has most of the share, that is told, and no axis.
// A d voltage below half of the EMF that an angle error of half a count makes is in doubt.
// Where no rows judge, every fourth of 24 blocks does. Counts that are moved (trace/rounding.hpp)
// make the slow errors of a speed that passes whole counts from row to row; they excuse nothing
// beside an error of a current or angle that is claimed, which might be theirs.
// On the 36 logs of set A (bench/blind) that lack nothing and had a structure, or none for a fault,
// an axis is left in 5 with all rules; in 8 without that of the sensors, in 12 without that of
// transfer, in 11 where an axis may move by its noise alone, in 26 by the means of fitted rows alone.
std::vector<Structure> residual_structure(const Fitter& fitter, const Fit& fit);
// A line (periodic_torque) that the selection needed.
Structure line_structure(const Effect& effect, const Selected& selected);
// The run that separates the kinds, in words.
std::string what_separates(const std::vector<std::string>& kinds);
// The same where no profile of speed, load and current does; empty: one may.
std::string beyond_a_run(const std::vector<std::string>& kinds);

}  // namespace twinrate
