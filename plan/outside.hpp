// Kinds without an information matrix: requirements on a run that shows them.
#pragma once
#include <optional>

#include "plan/plan.hpp"

namespace twinrate {

bool is_asked_for(const PlanRequest& request, const std::string& kind);
// If backlash is requested by name: the index in `all` of the first of the `usable` blocks that
// shows it, for the run in any case. Empty if not requested or if no usable block shows it.
std::optional<std::size_t> block_for_backlash(const PlanRequest& request,
                                              const std::vector<PlanBlock>& all,
                                              const std::vector<std::size_t>& usable);
// The requested kinds, compared with the plan and the logs.
std::vector<OutsideKind> outside_the_design(const Plan& plan, const std::vector<PlanLog>& logs,
                                            const DriveConfig& drive);

}  // namespace twinrate
