// Estimator and background gain in one process, as the two processes run in lock-step.
//
//   MEASUREMENT(k) -> ESTIMATE(k) -> GAIN(k) where k is a snapshot
#pragma once
#include "core/config.hpp"
#include "estimator/two_rate.hpp"

namespace twinrate {

class EstimatorLoop {
 public:
  // Throws BadInput where the config names an unknown filter.
  explicit EstimatorLoop(Config& config);
  // Runs tick m.k; the estimate is valid until the next tick.
  const Estimate& tick(const Measurement& m);
  // The gain of the last snapshot; has_gain() is true where the last tick was one.
  const Gain& gain() const { return background_.last(); }
  bool has_gain() const { return has_gain_; }
  // The filter knows the effects of `extended` from the next tick on; states and gains stay.
  void know(Config& extended);

 private:
  const DriveConfig drive_;
  FastLoop fast_;
  BackgroundLoop background_;
  Estimate estimate_;
  bool has_gain_ = false;
};

}  // namespace twinrate
