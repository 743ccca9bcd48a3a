#include "analysis/load_orders.hpp"

#include <algorithm>

#include "analysis/order_spectrum.hpp"
#include "analysis/tick_rows.hpp"

namespace twinrate {

LoadOrders load_orders(const RunLog& log, double settle_s, int max_orders) {
  constexpr int kHighestOrder = 200;
  std::vector<double> theta_m, T_o_hat;
  for (const TickRow& row : tick_rows(log)) {
    if (row.t_s < settle_s || !row.measurement || !row.estimate) continue;
    if (!(row.measurement->signals & kPosition)) continue;
    theta_m.push_back(row.measurement->theta_m);
    T_o_hat.push_back(row.estimate->T_load);
  }
  const OrderSpectrum spectrum = order_spectrum(theta_m, T_o_hat, kHighestOrder);
  LoadOrders found{.turns = spectrum.turns, .noise = spectrum.noise(kHighestOrder), .orders = {}};
  for (std::size_t i = 0; i < spectrum.amplitude.size(); ++i)
    if (spectrum.amplitude[i] > kDetectionRatio * found.noise)
      found.orders.push_back({static_cast<int>(i) + 1, spectrum.amplitude[i]});
  std::sort(found.orders.begin(), found.orders.end(),
            [](const LoadOrder& a, const LoadOrder& b) { return a.amplitude > b.amplitude; });
  if (found.orders.size() > static_cast<std::size_t>(max_orders))
    found.orders.resize(static_cast<std::size_t>(max_orders));
  std::sort(found.orders.begin(), found.orders.end(),
            [](const LoadOrder& a, const LoadOrder& b) { return a.order < b.order; });
  return found;
}

}  // namespace twinrate
