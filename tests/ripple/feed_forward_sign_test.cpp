// The sign of the feed-forward (41): inverted, it increases the ripple.
#include <gtest/gtest.h>

#include <cmath>

#include "estimator/two_rate.hpp"
#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"

namespace twinrate {
namespace {

// Speed ripple, rms over a turn at 20 rpm. The controller uses the estimated load only in its
// feed-forward, so `sign` = -1 is K_ff with the wrong sign.
double ripple_rms(const char* compensation, double sign) {
  Config config = test::load(
      "niewiara2020",
      {"reference.speed_rpm=20", std::string("controller.compensation=") + compensation});
  const DriveConfig& drive = config.drive();
  const std::shared_ptr<const Filter> filter = make_filter(config);
  Plant plant(config);
  FastLoop fast(filter, drive.gain.policy, drive.rates.n);
  BackgroundLoop background(filter, drive.gain.policy, drive.rates.n);
  const std::unique_ptr<Controller> controller = make_controller(config);
  constexpr std::int64_t kSettle = 15000, kTurn = 30000;
  double sum = 0, square = 0;
  for (std::int64_t k = 0; k < kSettle + kTurn; ++k) {
    const Measurement m = plant.sample();
    const Truth truth = plant.truth();
    Estimate estimate = fast.tick(m);
    fast.take_gain(background.step(estimate));
    estimate.T_load *= sign;
    plant.take_command(controller->step({m, estimate, drive.reference_at(k), &truth}));
    plant.advance();
    if (k < kSettle) continue;
    sum += truth.omega_m / kTurn;
    square += truth.omega_m * truth.omega_m / kTurn;
  }
  return std::sqrt(square - sum * sum);
}

TEST(FeedForward, ItsSignDecidesBetweenBetterAndWorse) {
  const double off = ripple_rms("off", 1);
  EXPECT_NEAR(off, 0.121, 0.15 * 0.121);
  const double right = ripple_rms("paper", 1) / off, wrong = ripple_rms("paper", -1) / off;
  EXPECT_GT(right, 0.55);
  EXPECT_LT(right, 0.75);
  EXPECT_GT(wrong, 1.3);  // 1.446 when written
  EXPECT_LT(wrong, 1.7);
}

}  // namespace
}  // namespace twinrate
