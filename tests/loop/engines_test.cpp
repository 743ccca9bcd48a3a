// The engines rk (the default) and erk against the referee, CVODE, in closed loop.
#include <gtest/gtest.h>

#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

// Largest difference of the true rotor currents over the run.
double current_difference(const Overrides& engine, const Overrides& overrides) {
  const auto with = [&](Overrides all) {
    all.insert(all.end(), overrides.begin(), overrides.end());
    return ClosedLoop(load("dilys2021", all));
  };
  ClosedLoop judged = with(engine), cvode = with({"plant.engine=cvode"});
  double largest = 0;
  for (std::int64_t k = 0; k < judged.drive().steps(); ++k) {
    judged.tick();
    cvode.tick();
    largest = std::max(largest, (judged.truth().i_dq - cvode.truth().i_dq).cwiseAbs().maxCoeff());
  }
  return largest;
}

const Overrides kRk{"plant.engine=rk"}, kErk{"plant.engine=erk", "plant.erk_steps=1"},
    kErkOfFour{"plant.engine=erk", "plant.erk_steps=4"};
const Overrides kIdealSensors{"sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0"};
// Sanitized builds run a quarter of the time.
const char* const kDuration = kSanitized ? "run.duration_s=0.5" : "run.duration_s=2.0";

TEST(Engines, RkAgreesToTwentyNanoampereWithIdealSensorsAndWithThePreset) {
  // CVODE's own error is most of it.
  for (Overrides overrides : {kIdealSensors, Overrides{}}) {
    overrides.emplace_back(kDuration);
    const double difference = current_difference(kRk, overrides);
    EXPECT_LT(difference, 2e-8);
    EXPECT_GT(difference, 1e-11);  // two engines, not one
  }
}

TEST(Engines, ErkAgreesToFiftyMicroampereWithIdealSensors) {
  Overrides overrides = kIdealSensors;
  overrides.emplace_back(kDuration);
  const double difference = current_difference(kErk, overrides);
  EXPECT_LT(difference, 5e-5);
  EXPECT_GT(difference, 1e-7);
}

TEST(Engines, ErkAgreesWithThePresetAsItIsInFourSteps) {
  // With one step the 5 uA between the engines sometimes change the rounding of the ADC: the
  // difference is then one count (4 mA).
  const double difference = current_difference(kErkOfFour, {kDuration});
  EXPECT_LT(difference, 5e-5);
  EXPECT_GT(difference, 1e-10);
}

TEST(Engines, OneStepOfErkDiffersByNoMoreThanOneAdcCountWithThePresetsSensors) {
  const double difference = current_difference(kErk, {kDuration});
  EXPECT_LT(difference, 0.004);
  EXPECT_GT(difference, 1e-7);
}

TEST(Engines, GiveTheSameAngleErrorFigure) {
  const double cvode = run("dilys2021", {"plant.engine=cvode"}).angle_error_rms;
  for (const Overrides& engine : {kRk, kErk})
    EXPECT_NEAR(run("dilys2021", engine).angle_error_rms, cvode, 1e-3 * cvode);
}

}  // namespace
}  // namespace twinrate::test
