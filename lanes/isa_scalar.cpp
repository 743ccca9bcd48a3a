#include "lanes/isa.hpp"

namespace twinrate::lanes {

struct Scalar;  // separates this unit's symbols: lanes/lanes.hpp

void run_scalar(const LaneSettings& settings, const LaneConstants<double>& c, Policy policy,
                const LaneQueue& queue) {
  run_lanes<Lanes<1, Scalar>>(settings, c, policy, queue);
}

}  // namespace twinrate::lanes
