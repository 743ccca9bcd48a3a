// Splits a fitted effect that is equivalent to two effects of the catalogue into these two, which
// are more common in drives.
#pragma once
#include "trace/considered.hpp"

namespace twinrate {

// phase_asymmetry: the part that all three phases have in common is a resistance. inverter_drop: a
// threshold is a dead time at one bus voltage, and a slope beyond that of
//                  switches is a resistance; inverter_drop then stays as their alias.
// Any other effect, and one of these two without such a part, is returned unchanged. Evidence and
// pictures are those of the two together; their sum is the fitted effect. An excluded kind is not
// split off.
std::vector<TracedEffect> split_equivalents(TracedEffect effect, const DriveFacts& facts,
                                            const Considered& considered = {});

}  // namespace twinrate
