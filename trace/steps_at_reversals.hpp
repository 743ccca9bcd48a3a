// Load steps that a friction makes.
#pragma once
#include <cstddef>
#include <vector>

#include "trace/fit.hpp"

namespace twinrate {

// The load steps that a friction makes: at two or more reversals of the motion, and at half of them
// at least, each against the new direction. Indices of `members`. A friction and a constant load of
// equal size were three load steps in a drawn log with 512 counts and coarse currents.
std::vector<std::size_t> steps_at_reversals(const Record& record, const Members& members);

}  // namespace twinrate
