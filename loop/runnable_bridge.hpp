// Checks of a drive file whose plant is a real drive behind the bridge.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"

namespace twinrate {

// Throws BadInput: a setting that the protocol of the drive does not offer, or that is not safe.
void require_drivable(Config& config);
// Settings that the link may not hold. Empty with a simulated plant.
std::vector<std::string> warnings_of_the_bridge(Config& config);

}  // namespace twinrate
