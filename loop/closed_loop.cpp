#include "loop/closed_loop.hpp"

#include "controller/make_controller.hpp"
#include "estimator/make_filter.hpp"

namespace twinrate {

ClosedLoop::ClosedLoop(Config& config)
    : drive_(config.drive()),
      plant_(drive_),
      fast_(make_fast_loop(config, false)),
      background_(make_background_loop(config)),
      controller_(make_controller(config)) {}

void ClosedLoop::know(Config& extended) {
  const auto filter = make_filter(extended);
  fast_.exchange(filter);
  background_.exchange(filter);
  controller_->know(extended.drive().model_effects());
}

const TickRecord& ClosedLoop::step() {
  const std::int64_t k = plant_.k();
  tick_.measurement = plant_.sample();
  tick_.truth = plant_.truth();
  tick_.estimate = fast_.tick(tick_.measurement);
  tick_.has_gain = drive_.sends_gain(k);
  if (tick_.has_gain) {
    tick_.gain = background_.step(tick_.estimate);
    fast_.take_gain(tick_.gain);
  }
  tick_.reference = drive_.reference_at(k);
  tick_.command =
      controller_->step({tick_.measurement, tick_.estimate, tick_.reference, &tick_.truth});
  tick_.event = controller_->take_event();
  plant_.take_command(tick_.command);
  plant_.advance();
  return tick_;
}

}  // namespace twinrate
