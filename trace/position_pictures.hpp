// Pictures for the page: the residual of logs of angle and current, before and after.
#pragma once
#include <vector>

#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// For each judged log: the current over the angle of a turn, and its orders, if the current holds
// the rotor; the change of the speed over time if the rotor moves.
std::vector<TracePicture> position_pictures(const Found& found, const Judge& judge);

}  // namespace twinrate
