#include "lanes/isa.hpp"

namespace twinrate::lanes {

struct Portable;  // separates this unit's symbols: lanes/lanes.hpp

void run_portable(const LaneSettings& settings, const LaneConstants<double>& c, Policy policy,
                  const LaneQueue& queue) {
  run_lanes<Lanes<1, Portable>>(settings, c, policy, queue);
}

}  // namespace twinrate::lanes
