// The default engine (ERK, fixed steps) against the reference (CVODE) in closed loop.
#include <gtest/gtest.h>

#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

// Largest difference of the true rotor currents over the run.
double current_difference(Overrides overrides, const char* erk_steps) {
  overrides.push_back(fmt::format("plant.erk_steps={}", erk_steps));
  ClosedLoop erk(load("dilys2021", overrides));
  overrides.push_back("plant.engine=cvode");
  ClosedLoop cvode(load("dilys2021", overrides));
  double largest = 0;
  for (std::int64_t k = 0; k < erk.drive().steps(); ++k) {
    erk.tick();
    cvode.tick();
    largest = std::max(largest, (erk.truth().i_dq - cvode.truth().i_dq).cwiseAbs().maxCoeff());
  }
  return largest;
}

const Overrides kIdealSensors{"sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0"};
// Sanitized builds run a quarter of the time.
const char* const kDuration = kSanitized ? "run.duration_s=0.5" : "run.duration_s=2.0";

TEST(Engines, AgreeToFiftyMicroampereWithIdealSensors) {
  Overrides overrides = kIdealSensors;
  overrides.emplace_back(kDuration);
  const double difference = current_difference(overrides, "1");
  EXPECT_LT(difference, 5e-5);
  EXPECT_GT(difference, 1e-7);  // two engines, not one
}

TEST(Engines, AgreeToFiftyMicroampereWithThePresetAsItIs) {
  // With one step the 5 uA between the engines sometimes change the rounding of the ADC: the
  // difference is then one count (4 mA).
  const double difference = current_difference({kDuration}, "4");
  EXPECT_LT(difference, 5e-5);
  EXPECT_GT(difference, 1e-10);
}

TEST(Engines, OneStepAnIntervalDiffersByNoMoreThanOneAdcCountWithThePresetsSensors) {
  const double difference = current_difference({kDuration}, "1");
  EXPECT_LT(difference, 0.004);
  EXPECT_GT(difference, 1e-7);
}

TEST(Engines, GiveTheSameAngleErrorFigure) {
  const double erk = run("dilys2021", {"plant.engine=erk"}).angle_error_rms;
  const double cvode = run("dilys2021", {"plant.engine=cvode"}).angle_error_rms;
  EXPECT_NEAR(erk, cvode, 1e-3 * cvode);
}

}  // namespace
}  // namespace twinrate::test
