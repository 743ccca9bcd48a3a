// The zero of an angle whose encoder's rounding is not known.
//
// A counter rounds down, and the record stands at the centres of its counts. A reading that was
// rounded to the nearest count stands there already: taken so, it lies half a count high. Which of
// the two it is shows on the d axis, for the magnets' voltage turns into it:
//
//   offset = sum_k c_k e_k / sum_k c_k^2,   e the residual along d, c the column of encoder_offset
//
// A quarter of a count to either side of half a count it was the nearest. Anything else is no
// rounding. Where counts are not declared, an encoder_offset of a count or less is the zero of the
// reading, and no claim: one that rounds up stands a whole count from where it is taken to.
#pragma once
#include "model/drive_facts.hpp"
#include "model/effects/effect.hpp"
#include "trace/record.hpp"
#include "trace/result.hpp"

namespace twinrate {

// rad, to be added to theta_m: 0, or half a count back.
double rounding_to_nearest(const Record& record, const DriveFacts& facts, const Effects& known);
// The same of what was found: 0 where no offset was, or a larger one.
double zero_within_count(const TraceResult& result, const Sensor& angle);
// Where it then stands; it is not asked for again.
Record moved(const Record& record, double by);

}  // namespace twinrate
