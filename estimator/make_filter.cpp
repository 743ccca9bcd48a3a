#include "estimator/make_filter.hpp"

#include <fmt/format.h>

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
  filter->know({drive.model_effects(), drive.machine, drive.sensors.current_sensors, drive.T_s()});
  return filter;
}

void require_policy(const Config& config, const Filter& filter) {
  const GainPolicy policy = config.drive().gain.policy;
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

FastLoop make_fast_loop(Config& config, bool fall_back) {
  const DriveConfig& drive = config.drive();
  const auto filter = make_filter(config);
  require_policy(config, *filter);
  ScheduleUse use;
  if (fall_back)
    use.max_age_ticks = drive.gain.max_age_ticks > 0 ? drive.gain.max_age_ticks : 4 * drive.rates.n;
  const bool scheduled = !has_background(drive.gain.policy);
  if (fall_back || scheduled) use.schedule = GainSchedule::build(*filter, drive.omega_m_limit());
  std::optional<Agreement> agreement;
  if (drive.locks_first())
    agreement.emplace(drive.machine, filter->turning_pairs() > 0, drive.T_s());
  return {filter, drive.gain.policy, drive.background_rate(), std::move(use), agreement};
}

BackgroundLoop make_background_loop(Config& config) {
  const DriveConfig& drive = config.drive();
  return {make_filter(config), drive.gain.policy, drive.background_rate(),
          drive.gain.speed_span / drive.machine.n_p};
}

}  // namespace twinrate
