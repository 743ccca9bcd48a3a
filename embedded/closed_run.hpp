// The closed loop of loop/closed_loop.hpp with any estimator in the place of the filter: the
// fixed-point filter on this machine, or the emulated processor.
#pragma once
#include <functional>

#include "core/config.hpp"
#include "core/run_log.hpp"
#include "loop/estimator_loop.hpp"

namespace twinrate {

using EstimatorTick = std::function<Estimate(const Measurement&)>;

// One tick of it; the references live until the next one.
struct ClosedTick {
  const Measurement& measurement;
  const Truth& truth;
  const Estimate& estimate;
  const Command& command;
};
// `trip`: text of a trip in tick k.
void run_closed(Config& config, const EstimatorTick& estimator,
                const std::function<void(const ClosedTick&)>& tick,
                const std::function<void(const EventRecord&)>& trip);

// The whole run of the drive file, in memory.
RunLog closed_run(Config& config, const EstimatorTick& estimator);

// The double-precision filter of the drive file, along a recorded run: what it would have estimated
// from the same measurements.
std::vector<Estimate> double_estimates(Config& config, const RunLog& log);

// Largest |theta_e| difference of two runs of estimates from tick `from` on, rad.
double largest_angle_difference(const std::vector<Estimate>& a, const std::vector<Estimate>& b,
                                std::size_t from = 0);

}  // namespace twinrate
