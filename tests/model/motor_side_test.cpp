#include "model/effects/motor_side.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace twinrate::motor_side_test {

constexpr double kStep_s = 2e-4;

// Swings with the load changing sides, and a seam half-way.
std::vector<OperatingPoint> swings(std::size_t rows) {
  std::vector<OperatingPoint> record(rows);
  for (std::size_t k = 0; k < rows; ++k) {
    const double t = static_cast<double>(k) * kStep_s;
    record[k].t = t + (k >= rows / 2 ? 1.0 : 0.0);
    record[k].theta_m = std::sin(9 * t) + 0.05 * std::sin(140 * t);
    record[k].T_load = 0.4 * std::sin(13 * t);
  }
  return record;
}

std::vector<ShaftFacts> random_gaps(std::size_t count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(0, 1);
  std::vector<ShaftFacts> shafts(count);
  for (ShaftFacts& s : shafts) {
    s.J_load = 0.001 + 0.003 * u(random);
    s.stiffness = 80 + 500 * u(random);
    s.damping = 0.02 + 0.3 * u(random);
    s.gap = 0.004 + 0.03 * u(random);
  }
  return shafts;
}

// What a shaft does does not depend on what stands beside it in the registers.
TEST(MotorSide, SeveralAtOnceAreWhatEachIsAlone) {
  const std::vector<OperatingPoint> record = swings(6000);
  const MotorSide motor(record, load_behind_shaft({}, record), kStep_s);
  for (std::size_t count : {1, 2, 3, 4, 5, 11}) {
    std::vector<ShaftFacts> shafts = random_gaps(count);
    if (count > 4) {
      shafts[1].gap = 0;
      shafts[2].J_load = 0;
    }
    std::vector<std::vector<double>> together(count);
    motor.along(shafts, together);
    for (std::size_t s = 0; s < count; ++s) {
      std::vector<double> alone(record.size());
      motor.along(shafts[s], alone);
      EXPECT_EQ(together[s], alone) << s << " of " << count;
    }
  }
}

// The shafts of the test above lift off and land.
TEST(MotorSide, FlanksOnlyPush) {
  const std::vector<OperatingPoint> record = swings(6000);
  const MotorSide motor(record, std::vector<double>(record.size()), kStep_s);
  for (const ShaftFacts& shaft : random_gaps(4)) {
    std::vector<double> T_load(record.size());
    motor.along(shaft, T_load);
    int upper = 0, lower = 0, free = 0;
    for (double T : T_load) ++(T > 0 ? upper : T < 0 ? lower : free);
    EXPECT_GT(upper, 300);
    EXPECT_GT(lower, 300);
    EXPECT_GT(free, 300);
  }
}

}  // namespace twinrate::motor_side_test
