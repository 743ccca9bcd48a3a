#include "trace/drop_shape.hpp"

#include <fmt/format.h>

#include <iterator>

#include "model/effects/catalogue.hpp"
#include "model/effects/shapes.hpp"
#include "trace/keys.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {
namespace {

constexpr const char* kShape = "shape";
constexpr const char* kZone = "linear_current_A";
constexpr double kZoneOfSmooth = 0.7;  // of that of the clamped drop nearest to a smooth one

}  // namespace

Fit with_best_shape(const Fitter& fitter, Fit fit, const Say& say) {
  const Effect& drop = *fit.members.back();
  if (!has_key(drop, kShape)) return fit;
  // A smooth drop without a slope may have a negative one beside a wrong zone. The simpler one comes
  // first: a later one has to be better by the margin.
  std::vector<std::shared_ptr<Effect>> starts;
  if (reading_of(drop, Traits::Reading::kItsThreshold))
    if (auto dead_time = equivalent_dead_time(drop, fitter.chain().equations().facts()))
      starts.push_back(std::move(dead_time));
  starts.push_back(drop.clone());
  double best = score_of(fitter, fit);
  Fit found;
  for (const std::shared_ptr<Effect>& start : starts)
    for (std::size_t shape = 0; shape < std::size(kCurrentShapeNames); ++shape) {
      Members members = with(fit.members, nullptr);
      members.back() = start->clone();
      if (get_key(drop, kShape) == static_cast<double>(shape) ||
          !set_key(*members.back(), kShape, static_cast<double>(shape)) ||
          !set_key(*members.back(), kZone, kZoneOfSmooth * get_key(*start, kZone)))
        continue;
      Fit other = fitter.refine(std::move(members));
      if (!other.valid || score_of(fitter, other) > best - fitter.margin() ||
          other.rss_held_out > fit.rss_held_out)
        continue;
      if (say)
        say(fmt::format("  {} with the shape {}: score {:.0f} -> {:.0f}", start->kind(),
                        kCurrentShapeNames[shape], best, score_of(fitter, other)));
      best = score_of(fitter, other);
      found = std::move(other);
    }
  return found.members.empty() ? std::move(fit) : std::move(found);
}

}  // namespace twinrate
