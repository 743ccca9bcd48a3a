// Test angles.
#pragma once
#include <vector>

#include "model/frames.hpp"

namespace twinrate::test {

// `count` angles from 0 on, uniform over one turn.
inline std::vector<double> angles_over_a_turn(int count) {
  std::vector<double> angles;
  angles.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) angles.push_back(i * kTwoPi / count);
  return angles;
}

}  // namespace twinrate::test
