// An effect that begins at a time: zero before from_s, the effect itself from then on. For drives
// whose plant changes while it runs ([[effect]] from_s).
#pragma once
#include <string>

#include "model/effects/effect.hpp"

namespace twinrate {

// `effect` itself if from_s is 0.
std::shared_ptr<const Effect> delayed(std::shared_ptr<const Effect> effect, double from_s);
// "" or why this effect cannot begin later: it has a memory, or changes the structure of a plant.
std::string why_not_delayed(const Effect& effect);

}  // namespace twinrate
