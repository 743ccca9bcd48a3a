// Estimator and background gain in one process, equal to the two processes in lock-step.
//
//   MEASUREMENT(k) -> ESTIMATE(k) -> GAIN(k) if k is a snapshot
#pragma once
#include "core/config.hpp"
#include "estimator/make_filter.hpp"

namespace twinrate {

class EstimatorLoop {
 public:
  // Throws BadInput if the config names an unknown filter.
  explicit EstimatorLoop(Config& config, const MakeFilter& make = make_filter,
                         const GainTable& table = nullptr);
  // Runs tick m.k. The returned estimate is valid until the next tick.
  const Estimate& tick(const Measurement& m);
  // The gain of the last snapshot; has_gain(): the last tick was a snapshot.
  const Gain& gain() const { return background_.last(); }
  bool has_gain() const { return has_gain_; }
  // The filter compensates the effects of `extended` from the next tick on; states and gains stay.
  void know(Config& extended);
  // The next sample begins a session; the background continues.
  void restart() { fast_.reset(); }

 private:
  const RateHistory rates_;
  const MakeFilter make_;
  FastLoop fast_;
  BackgroundLoop background_;
  bool has_gain_ = false;
};

}  // namespace twinrate
