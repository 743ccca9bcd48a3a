#include "loop/closed_loop.hpp"

#include "controller/make_controller.hpp"
#include "core/steering.hpp"

namespace twinrate {

ClosedLoop::ClosedLoop(Config& config, const MakeFilter& make, const GainTable& table)
    : config_(&config),
      drive_(config.drive()),
      plant_(config),
      estimator_(config, make, table),
      controller_(make_controller(config)) {
  for (const std::int64_t k : planned_resets(config)) resets_.push_back(k);
  for (const std::int64_t k : drive_.model_changes()) planned_.push_back({k, config.known_at(k)});
}

void ClosedLoop::know(Config& extended) {
  estimator_.know(extended);
  known_ = extended.drive().model_effects();
  controller_->know(*known_);
}

std::string ClosedLoop::reset() {
  const std::string why = plant_.reset();
  if (!why.empty()) return why;
  restart();
  return "";
}

void ClosedLoop::restart() {
  estimator_.restart();
  controller_ = make_controller(*config_, Begin::kAfterReset);
  if (known_) controller_->know(*known_);
}

const TickRecord& ClosedLoop::step() {
  for (; !planned_.empty() && plant_.k() >= planned_.front().k; planned_.pop_front())
    know(planned_.front().extended);
  for (; !resets_.empty() && plant_.k() >= resets_.front(); resets_.pop_front()) restart();
  const Measurement& m = plant_.sample();
  const Truth truth = plant_.truth();
  const bool every_tick = tick_.estimate.status & kGainEveryTick;
  const Estimate& e = estimator_.tick(m);
  tick_.gain_every_nth = every_tick && !(e.status & kGainEveryTick);
  tick_.has_gain = estimator_.has_gain();
  const Reference reference = drive_.reference_at(m.k);
  const Command command = controller_->step({m, e, reference, &truth});
  plant_.take_command(command);
  // Copied after all of them are written: a copy waits for the last writes.
  tick_.measurement = m;
  tick_.estimate = e;
  tick_.truth = truth;
  tick_.reference = reference;
  tick_.command = command;
  if (tick_.has_gain) copy_gain(tick_.gain, estimator_.gain());
  tick_.event = controller_->take_event();
  plant_.advance();
  tick_.plant_events.clear();
  for (int i = 0; i < plant_.safety().event_count(); ++i) {
    const SafetyEvent& event = plant_.safety().event(i);
    tick_.plant_events.push_back({event.reason, text_of(event, plant_.safety())});
  }
  return tick_;
}

}  // namespace twinrate
