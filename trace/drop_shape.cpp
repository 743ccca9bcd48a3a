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
  // first: what comes later has to be better by the margin.
  std::vector<std::shared_ptr<Effect>> starts{drop.clone()};
  if (reading_of(drop, Traits::Reading::kItsThreshold))
    if (auto dead_time = equivalent_dead_time(drop, fitter.chain().equations().facts()))
      starts.insert(starts.begin(), std::move(dead_time));
  const Members others = with(fit.members, nullptr, fit.members.size() - 1);
  double best = score_of(fitter, fit);
  Fit found;
  for (const std::shared_ptr<Effect>& start : starts)
    for (std::size_t shape = 1; shape < std::size(kCurrentShapeNames); ++shape) {
      const std::shared_ptr<Effect> smooth = start->clone();
      if (!set_key(*smooth, kShape, static_cast<double>(shape)) ||
          !set_key(*smooth, kZone, kZoneOfSmooth * get_key(*start, kZone)))
        continue;
      Fit other = fitter.refine(with(others, smooth));
      if (say)
        say(fmt::format("  {} with the shape {}: score {:.0f} -> {:.0f}{}", start->kind(),
                        kCurrentShapeNames[shape], score_of(fitter, fit), score_of(fitter, other),
                        other.valid ? "" : " (refused)"));
      if (!other.valid || score_of(fitter, other) > best - fitter.margin()) continue;
      best = score_of(fitter, other);
      found = std::move(other);
    }
  return found.members.empty() ? std::move(fit) : std::move(found);
}

}  // namespace twinrate
