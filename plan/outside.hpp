// Kinds that no information matrix judges: what a run needs to show them.
#pragma once
#include <optional>

#include "plan/plan.hpp"

namespace twinrate {

bool is_asked_for(const PlanRequest& request, const std::string& kind);
// Of `usable` indices of `all`, the block that shows a backlash where it was asked for by name, to
// be taken whatever it is worth to the others; none where it was not or the drive keeps to none.
std::optional<std::size_t> block_for_backlash(const PlanRequest& request,
                                              const std::vector<PlanBlock>& all,
                                              const std::vector<std::size_t>& usable);
// Those of the request, held against the plan and the logs.
std::vector<OutsideKind> outside_the_design(const Plan& plan, const std::vector<PlanLog>& logs,
                                            const DriveConfig& drive);

}  // namespace twinrate
