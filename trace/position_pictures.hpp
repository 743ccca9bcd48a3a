// What the model leaves of logs of angle and current, before and after, for the page.
#pragma once
#include <vector>

#include "trace/position_judge.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Of each log judged: of one that holds the rotor the current over the angle of a turn, and its
// orders; of one that moves the change of the speed over time.
std::vector<TracePicture> position_pictures(const Found& found, const Judge& judge);

}  // namespace twinrate
