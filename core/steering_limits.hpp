// The largest values that a request can ask a drive for (core/steering.hpp refuses more).
#pragma once
#include "core/config.hpp"
#include "core/steering.hpp"

namespace twinrate {

struct SteeringLimits {
  double omega_m = 0;  // rad/s: the fastest of rated speed and references of the drive file
  double load = 0;     // Nm: steering.load_max_Nm, or a steady load that the drive is made for
};
SteeringLimits steering_limits(const DriveConfig& drive, const SteeringParameters& steering);

}  // namespace twinrate
