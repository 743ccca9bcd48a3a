// The orders detected in the estimated load of a run.
#pragma once
#include <vector>

#include "core/run_log.hpp"

namespace twinrate {

struct LoadOrder {
  int order = 0;
  double amplitude = 0;  // Nm
};

struct LoadOrders {
  int turns = 0;     // whole turns used; 0: less than one, or no position or estimate in the log
  double noise = 0;  // Nm, noise level of the amplitude of an order
  std::vector<LoadOrder> orders;
};

// The largest orders of T_o_hat above kDetectionRatio times the noise, up to order 200, over the
// whole turns after settle_s. At most `max_orders`, in rising order.
LoadOrders load_orders(const RunLog& log, double settle_s, int max_orders);

}  // namespace twinrate
