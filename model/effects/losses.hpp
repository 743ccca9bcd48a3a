// Losses that cannot be gains: friction and what an inverter drops. A model may hold one below zero
// that takes from another of its kind, or from machine.B, where that was declared too large; in all
// none is left below zero.
#pragma once
#include <string>

#include "model/effects/effect.hpp"

namespace twinrate {

struct MachineParameters;

// A loss below zero.
bool takes_back(const Effect& effect);
// "" or which of them is below zero in all.
std::string negative_loss(const Effects& effects, const MachineParameters& machine);

}  // namespace twinrate
