// Effects that leave a machine parameter beyond what a working drive can have: another machine, a
// unit or a scale, and no effect.
#pragma once
#include <string>
#include <utility>

#include "model/drive_facts.hpp"
#include "model/effects/effect.hpp"

namespace twinrate {

// The smallest share of a machine parameter that an effect leaves, and the name of the parameter. 1
// and "" if it lowers none.
std::pair<double, const char*> least_left(const Effect& effect, const MachineParameters& machine);
// Reason why the machine with the effect is another one; empty if it is not. `share`: of the
// parameter that is out of bounds, or 0.
std::string another_machine(const Effect& effect, const DriveFacts& facts, double& share);

}  // namespace twinrate
