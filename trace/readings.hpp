// The log read in another way: other angles, another order of the phases.
#pragma once
#include <vector>

#include "trace/result.hpp"
#include "trace/scale_factors.hpp"

namespace twinrate {

// The log does not fit as it is, and does in another reading: in the voltage, or, where that says
// nothing or fits, in the torque. A voltage that is mostly EMF fits with any current.
std::vector<Inconsistency> of_readings(const Record& record, const DriveFacts& facts,
                                       const ScaleFactors& as_it_is, int encoder_counts);

}  // namespace twinrate
