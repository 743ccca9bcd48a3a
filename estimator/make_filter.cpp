#include "estimator/make_filter.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "core/steering.hpp"
#include "estimator/propagated_gain.hpp"

namespace twinrate {

std::shared_ptr<const Filter> make_filter(Config& config) {
  const std::string& kind = config.drive().estimator.kind;
  const auto builder = filter_builder(kind, config.drive());
  if (!builder)
    throw BadInput(fmt::format("{}: estimator.kind: one of {} allowed, found {}",
                               config.where("estimator.kind"), fmt::join(filter_kinds(), ", "),
                               kind));
  config.read_table("estimator." + kind, [&](FieldVisitor& f) { builder->fields(f); });
  const DriveConfig& drive = config.drive();
  const std::shared_ptr<Filter> filter = builder->build(drive);
  filter->know(known_effects(drive));
  return filter;
}

KnownEffects known_effects(const DriveConfig& drive) {
  return {drive.model_effects(), drive.machine, drive.sensors.current_sensors, drive.T_s()};
}

void require_policy(const Config& config, const Filter& filter) {
  require_policy(config, filter, config.drive().gain.policy);
}

void require_policy(const Config& config, const Filter& filter, GainPolicy policy) {
  if (!has_background(policy) && !filter.steady_state(0))
    throw BadInput(
        fmt::format("{}: gain.policy: scheduled needs a filter with a steady state, {} "
                    "has none",
                    config.where("gain.policy"), filter.kind()));
  if (policy == GainPolicy::kPropagated && !offers_propagated(filter))
    throw BadInput(
        fmt::format("{}: gain.policy: propagated needs a filter in the stationary frame with a "
                    "steady state, {} has none",
                    config.where("gain.policy"), filter.kind()));
}

std::string compensation_needs(Compensation wanted, const DriveConfig& drive,
                               const Filter& filter) {
  if (wanted == Compensation::kLoad || wanted == Compensation::kPaper)
    return filter.estimates_load()
               ? ""
               : fmt::format("an estimator.kind that estimates the load, {} does not",
                             drive.estimator.kind);
  if (wanted != Compensation::kAngleDomain) return "";
  if (drive.controller.kind != "lqr") return "controller.kind = lqr";
  const bool measured = drive.controller.angle_source != AngleSource::kEstimate ||
                        filter.output({}, {}).status & kMeasuredAngle;
  return measured ? "" : "a measured angle: estimator.kind = ekf_disturbance or ekf_harmonic";
}

bool uses_table(Config& config) {
  const std::vector<RateChange> changes = rate_history(config).changes();
  return !has_background(config.drive().gain.policy) ||
         std::ranges::any_of(changes,
                             [](const RateChange& c) { return !has_background(c.policy); });
}

FastLoop make_fast_loop(Config& config, bool fall_back, const MakeFilter& make,
                        const GainTable& table) {
  const DriveConfig& drive = config.drive();
  const auto filter = make(config);
  require_policy(config, *filter);
  ScheduleUse use;
  if (fall_back)
    use.max_age_ticks = drive.gain.max_age_ticks > 0 ? drive.gain.max_age_ticks : 4 * drive.rates.n;
  const std::vector<RateChange> changes = rate_history(config).changes();
  for (const RateChange& change : changes) require_policy(config, *filter, change.policy);
  if (fall_back || uses_table(config))
    use.schedule = table ? table : GainSchedule::build(*filter, drive.omega_m_limit());
  std::optional<Agreement> agreement;
  if (drive.locks_first())
    agreement.emplace(drive.machine, filter->turning_pairs() > 0, drive.T_s());
  FastLoop fast(filter, drive.gain.policy, drive.background_rate(), std::move(use), agreement);
  fast.follow(changes);
  return fast;
}

BackgroundLoop make_background_loop(Config& config, const MakeFilter& make) {
  const DriveConfig& drive = config.drive();
  const std::shared_ptr<const Filter> filter = make(config);
  BackgroundLoop background(filter, drive.gain.policy, drive.background_rate(),
                            drive.gain.speed_span / drive.machine.n_p);
  background.limit(CovarianceCeiling(*filter, 0.5 * drive.omega_m_limit()));
  background.follow(rate_history(config).changes());
  return background;
}

}  // namespace twinrate
