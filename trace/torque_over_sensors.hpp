// Whether the torque residual is more than noise of the sensors.
#pragma once
#include "trace/chain.hpp"

namespace twinrate {

// Rms of the torque residual over that of `noise` and of what rows leave open of the torque between them, all after the
// filter that makes `noise` white: an angle's noise makes a torque that grows with the square of the frequency, and
// would hide a slow one. 0: no row has both.
double torque_over_sensors(const Chain& chain, const Sampled& left, const Eigen::VectorXd& noise);

}  // namespace twinrate
