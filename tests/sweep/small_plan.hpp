// A small sweep, and one point of it in the lanes.
#pragma once
#include "sweep/point.hpp"

namespace twinrate::sweep {

inline Plan small_plan() {
  return {.drive = "dilys2021",
          .speeds_Hz = {150, 200},
          .policies = {"paper"},
          .seeds = 2,
          .n_max = 50};
}

inline Point in_lanes(const Plan& plan, const DriveConfig& base, const Search& search, int n) {
  const Task task{search, n};
  return run_in_lanes(plan, lane_drive(plan, base, search).value(), {&task, 1}, 1).at(0);
}

}  // namespace twinrate::sweep
