// Two results of one log, whose rows were read in two ways: what they show together.
#pragma once
#include <optional>

#include "trace/result.hpp"

namespace twinrate {

// One of the two if both have the same effects, at least one of them in the voltage equation, and
// no structure of the voltage remains: each effect of one has a partner of the same kind in the
// other, of a size within a factor of two, and its parameters differ by less than half. It is
// `first` if its aliases include those of `second`, else `second` if its include those of `first`;
// if one alone leaves a structure of the torque, it is that one. The standard deviation of a
// parameter is at least the difference of the two, and a kind is identifiable if both say so. Empty:
// they show different things.
std::optional<TraceResult> shown_by_both(const TraceResult& first, const TraceResult& second);

// True if `one` names effects of the voltage and no structure remains, while `other` leaves a structure
// in the voltage, and more than twice the energy beyond the noise.
bool explains_alone(const TraceResult& one, const TraceResult& other);

}  // namespace twinrate
