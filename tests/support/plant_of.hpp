#pragma once
#include "plant_sim/plant.hpp"

namespace twinrate::test {

// The plant of a drive file.
inline Plant plant_of(Config config) {
  return Plant(config);
}

}  // namespace twinrate::test
