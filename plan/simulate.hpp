// A planned run in one process, with nothing missing: the plant has what the model knows, and the
// sensors the noise that the drive file declares.
#pragma once
#include "plan/plan.hpp"

namespace twinrate {

struct PlannedRun {
  RawLog raw;
  // Of each tick: not what was planned. The speed is off a constant reference by more than 20 % (as
  // analysis/summary.hpp has it), or the current is 1.3 times what the bench allows.
  std::vector<char> off_plan;
  // The estimate of the angle, 90 deg off; the controller does not use it.
  bool filter_lost = false;
};

// `overrides`: of the drive file. Ends early where `hooks.stop` says so, or where the drive leaves
// what can be computed.
PlannedRun simulate_planned(const Config& drive, const std::vector<std::string>& overrides,
                            double i_max, const std::string& what, const PlanHooks& hooks);

}  // namespace twinrate
