#include "loop/estimator_loop.hpp"

#include "core/steering.hpp"

namespace twinrate {

EstimatorLoop::EstimatorLoop(Config& config, const MakeFilter& make, const GainTable& table)
    : rates_(rate_history(config)),
      make_(make),
      fast_(make_fast_loop(config, false, make, table)),
      background_(make_background_loop(config, make)) {}

const Estimate& EstimatorLoop::tick(const Measurement& m) {
  const Estimate& e = fast_.tick(m);
  has_gain_ = rates_.sends_gain(e.k, e.status);
  if (has_gain_) fast_.take_gain(background_.step(e));
  return e;
}

void EstimatorLoop::know(Config& extended) {
  const auto filter = make_(extended);
  fast_.exchange(filter);
  background_.exchange(filter);
}

}  // namespace twinrate
