// The zero of an angle if the rounding of its encoder is unknown.
//
// A counter rounds down, so the record holds the centres of the counts. A reading that was rounded
// to the nearest count is at the centre already, and the record is then half a count too high. The
// d axis shows which rounding holds, because the voltage of the magnets turns into it:
//
//   offset = sum_k c_k e_k / sum_k c_k^2,   e the residual voltage, c the column of encoder_offset
//
// both beside the effects that explain more of e: the EMF of an iron loss or of an inductance has a
// part along c. An offset of half a count, within a quarter of a count, means rounding to the
// nearest. Any other offset is not a rounding. If the drive file declares no counts, an
// encoder_offset of a count or less is taken as the zero of the reading and not as an effect: a
// counter that rounds up is read a whole count off. Of declared counts half a count is in doubt:
// beside a missing saturation, 500 counts made a false offset of 0.3 counts and 12 standard
// deviations.
#pragma once
#include "model/drive_facts.hpp"
#include "model/effects/effect.hpp"
#include "trace/record.hpp"
#include "trace/result.hpp"

namespace twinrate {

// rad, to add to theta_m: 0, or minus half a count.
double rounding_to_nearest(const Record& record, const DriveFacts& facts, const Effects& known);
// rad, of the zero of an angle whose counts the drive file declares (0: it does not): a smaller
// offset is no effect. 0: the zero is known.
double zero_in_doubt(const Sensor& angle, int declared_counts);
// The same as rounding_to_nearest from the traced effects: 0 if there is no encoder_offset, or one
// beyond `in_doubt` (rad).
double zero_within(double in_doubt, const TraceResult& result);
// The record with theta_m + by. Its rounding counts as known.
Record moved(const Record& record, double by);

}  // namespace twinrate
