#include "loop/estimator_loop.hpp"

#include "estimator/make_filter.hpp"

namespace twinrate {

EstimatorLoop::EstimatorLoop(Config& config)
    : drive_(config.drive()),
      fast_(make_fast_loop(config, false)),
      background_(make_background_loop(config)) {}

const Estimate& EstimatorLoop::tick(const Measurement& m) {
  estimate_ = fast_.tick(m);
  has_gain_ = drive_.sends_gain(estimate_);
  if (has_gain_) fast_.take_gain(background_.step(estimate_));
  return estimate_;
}

void EstimatorLoop::know(Config& extended) {
  const auto filter = make_filter(extended);
  fast_.exchange(filter);
  background_.exchange(filter);
}

}  // namespace twinrate
