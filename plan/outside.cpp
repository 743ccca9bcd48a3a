#include "plan/outside.hpp"

#include <algorithm>

#include "model/effects/catalogue.hpp"
#include "trace/bus_ripple.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr const char* kBacklashBlocks[] = {"reversals"};  // small reversals do not show it
constexpr double kMinRippleRun_s = 1;

bool shows_backlash(const PlanBlock& block) {
  return std::any_of(std::begin(kBacklashBlocks), std::end(kBacklashBlocks),
                     [&](const char* name) { return block.name == name; });
}

std::string kind_placed(Traits::Place place) {
  return std::string(make_placed(place)->kind());
}

OutsideKind gap(const Plan& plan, const std::vector<PlanLog>& logs) {
  OutsideKind k{.kind = kind_placed(Traits::Place::kGap),
                .needs = "reversals without load: the load inertia must cross the gap repeatedly",
                .shown_by = {std::begin(kBacklashBlocks), std::end(kBacklashBlocks)}};
  k.in_run = std::any_of(plan.order.begin(), plan.order.end(),
                         [&](std::size_t b) { return shows_backlash(plan.blocks[b]); });
  if (!logs.empty()) k.log = "not tested: trace the log";
  return k;
}

OutsideKind bus_line(const Plan& plan, const std::vector<PlanLog>& logs, const DriveConfig& drive) {
  OutsideKind k{.kind = kind_placed(Traits::Place::kBusLine),
                .needs = "v_dc logged in every row, for a second or longer, in any run",
                .shown_by = {}};
  k.in_run = plan.profile.duration_s >= kMinRippleRun_s;
  for (const PlanLog& log : logs) {
    const BusRipple found = find_bus_ripple(
        log.record, held_out_rows(log.record, TraceSettings().holdout, drive.machine.n_p),
        drive.facts(), drive.model_effects());
    k.log = found.blind.empty() ? "would show" : found.blind;
    if (found.blind.empty()) break;
  }
  return k;
}

}  // namespace

bool is_asked_for(const PlanRequest& request, const std::string& kind) {
  return request.kinds.empty() ||
         std::find(request.kinds.begin(), request.kinds.end(), kind) != request.kinds.end();
}

std::optional<std::size_t> block_for_backlash(const PlanRequest& request,
                                              const std::vector<PlanBlock>& all,
                                              const std::vector<std::size_t>& usable) {
  if (request.kinds.empty() || !is_asked_for(request, kind_placed(Traits::Place::kGap))) return {};
  for (std::size_t b : usable)
    if (shows_backlash(all[b]) && all[b].duration_s <= request.longest_s) return b;
  return {};
}

std::vector<OutsideKind> outside_the_design(const Plan& plan, const std::vector<PlanLog>& logs,
                                            const DriveConfig& drive) {
  std::vector<OutsideKind> list;
  for (OutsideKind& k : std::vector{gap(plan, logs), bus_line(plan, logs, drive)})
    if (is_asked_for(plan.request, k.kind)) list.push_back(std::move(k));
  return list;
}

}  // namespace twinrate
