// What the disturbance filter makes of niewiara2020's reference set: the paper's Fig. 6.
#include <gtest/gtest.h>

#include <algorithm>

#include "core/order_spectrum.hpp"
#include "tools/load_drive.hpp"
#include "tools/run/closed_loop.hpp"

namespace twinrate {
namespace {

constexpr int kOrders = 60;

// T_o_hat over the last `turns` turns at one speed, compensation off.
OrderSpectrum estimated_torque_spectrum(double speed_rpm, int turns) {
  Config config = load_drive("niewiara2020", {"reference.speed_rpm=" + std::to_string(speed_rpm),
                                              "controller.compensation=off"});
  ClosedLoop loop(config);
  constexpr double kSettle_s = 1.5;
  const double end_s = kSettle_s + (turns + 0.05) * 60 / speed_rpm;
  std::vector<double> theta_m, T_o_hat;
  for (double t_s = 0; t_s < end_s; t_s += config.drive().T_s()) {
    const TickRecord& tick = loop.step();
    if (t_s < kSettle_s) continue;
    theta_m.push_back(tick.measurement.theta_m);
    T_o_hat.push_back(tick.estimate.T_load);
  }
  return order_spectrum(theta_m, T_o_hat, kOrders);
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The reference orders far above the noise, and no others: a filter that invents orders fails too.
void expect_the_reference_orders(double speed_rpm, int turns) {
  constexpr int kReferenceOrders[] = {1, 3, 6, 12, 18, 27, 36, 54};
  const OrderSpectrum spectrum = estimated_torque_spectrum(speed_rpm, turns);
  ASSERT_EQ(spectrum.turns, turns);
  const double noise = median(spectrum.amplitude);
  EXPECT_GT(noise, 1e-5);
  EXPECT_LT(noise, 1e-3);
  for (int N = 1; N <= kOrders; ++N) {
    const double ratio = spectrum.amplitude[static_cast<std::size_t>(N - 1)] / noise;
    if (std::ranges::count(kReferenceOrders, N) > 0)
      EXPECT_GT(ratio, 20) << "order " << N << " at " << speed_rpm << " rpm";
    else
      EXPECT_LT(ratio, 15) << "order " << N << " at " << speed_rpm << " rpm";
  }
}

TEST(EstimatedTorque, ShowsTheOrdersOfTheReferenceSetAboveTheNoiseAt50Rpm) {
  expect_the_reference_orders(50, 4);
}

TEST(EstimatedTorque, ShowsTheOrdersOfTheReferenceSetAboveTheNoiseAt20Rpm) {
  expect_the_reference_orders(20, 2);
}

}  // namespace
}  // namespace twinrate
