// Splits a fitted effect that is equivalent to two of the catalogue into these two, which are more
// common in drives.
#pragma once
#include "trace/considered.hpp"

namespace twinrate {

// phase_asymmetry: what all three phases have in common is a resistance.
// inverter_drop:   a threshold is a dead time at one bus voltage, and a slope beyond that of
//                  switches a resistance; inverter_drop then stays as their alias.
// Any other effect, and these two without such a part, come back as they are. Evidence and pictures
// are those of the two together; the sum of both is the effect that was fitted.
// An excluded kind is no part of it.
std::vector<TracedEffect> split_equivalents(TracedEffect effect, const DriveFacts& facts,
                                            const Considered& considered = {});

}  // namespace twinrate
