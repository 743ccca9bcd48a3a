// Simulates a planned run in one process. The plant has the effects of the model, the sensors the
// noise of the drive file.
#pragma once
#include "plan/plan.hpp"

namespace twinrate {

struct PlannedRun {
  RawLog raw;
  // For each tick: the speed is off a constant reference by more than 20 % (analysis/summary.hpp),
  // or the current exceeds 1.3 times the limit of the bench.
  std::vector<char> off_plan;
  // The angle error passed 90 deg. The controller uses the measured angle.
  bool filter_lost = false;
};

// `overrides`: keys of the drive file. Ends early if `hooks.stop` returns true or the integrator
// fails.
PlannedRun simulate_planned(const Config& drive, const std::vector<std::string>& overrides,
                            double i_max, const std::string& what, const PlanHooks& hooks);

}  // namespace twinrate
