// Losses that cannot be gains: friction and inverter drops. A model may hold a loss below zero if
// it reduces another of its kind, or machine.B, that was declared too large; their sum must not be
// below zero.
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
