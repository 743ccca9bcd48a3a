#include "lanes/isa.hpp"

namespace twinrate::lanes {

struct Avx2;  // separates this unit's symbols: lanes/lanes.hpp

void run_avx2(const LaneSettings& settings, const LaneConstants<double>& c, Policy policy,
              const LaneQueue& queue) {
  run_lanes<Lanes<4, Avx2>>(settings, c, policy, queue);
}

}  // namespace twinrate::lanes
