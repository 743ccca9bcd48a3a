// The closed loop of loop/closed_loop.hpp with another estimator instead of its filter: the
// fixed-point filter on this machine, or the emulated processor.
#pragma once
#include <functional>

#include "core/config.hpp"
#include "core/run_log.hpp"
#include "loop/estimator_loop.hpp"

namespace twinrate {

using EstimatorTick = std::function<Estimate(const Measurement&)>;

// One tick of the run; the references are valid until the next tick.
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

// The estimates of the drive file's double-precision filter from the measurements of a recorded
// run.
std::vector<Estimate> double_estimates(Config& config, const RunLog& log);

// Largest |theta_e| difference of two runs of estimates from tick `from` on, rad.
double largest_angle_difference(const std::vector<Estimate>& a, const std::vector<Estimate>& b,
                                std::size_t from = 0);

}  // namespace twinrate
