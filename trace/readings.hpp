// Other readings of the log: other angles, another order of the phases.
#pragma once
#include <vector>

#include "trace/result.hpp"
#include "trace/scale_factors.hpp"

namespace twinrate {

struct OtherReading {
  const char* quantity;
  const char* expected;
  const char* hint;
  Reading reading;
  double K_t_J = 1;  // over the declared, if it is what differs
};

std::vector<OtherReading> other_readings(int n_p, int encoder_counts);
// The other readings that fit if the log as it is does not. The voltage decides or, if it is of no
// use or fits, the torque: a voltage that is mostly EMF fits with any current.
std::vector<Inconsistency> of_readings(const Record& record, const DriveFacts& facts,
                                       const ScaleFactors& as_it_is, int encoder_counts);

}  // namespace twinrate
