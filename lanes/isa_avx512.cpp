#include "lanes/isa.hpp"

namespace twinrate::lanes {

struct Avx512;  // separates this unit's symbols: lanes/lanes.hpp

void run_avx512(const LaneSettings& settings, const LaneConstants<double>& c, Policy policy,
                const LaneQueue& queue) {
  run_lanes<Lanes<8, Avx512>>(settings, c, policy, queue);
}

}  // namespace twinrate::lanes
