// The scales of a log against the drive file where the angle is coarse or begins anew.
#include "trace/scale_factors.hpp"

#include <gtest/gtest.h>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/consistency.hpp"

namespace twinrate {
namespace {

// In a cell of 4 ms the rotor turns by a count or two.
TEST(ScaleFactors, ASlowCoarseEncoderAttenuatesNoMagnet) {
  Health health;
  const Record record = make_record(
      simulate_synthetic({.duration_s = 2, .counts = 256, .speeds = 0.04, .loads = 0.3}),
      servo().machine.n_p, health);
  const ScaleFactors f = scale_factors(record, servo().facts());
  EXPECT_LT(f.psi_f.value, 0.8);
  EXPECT_LT(std::abs(f.psi_f.log()), 4 * f.psi_f.log_sigma());
  EXPECT_GT(f.rounded_share, 0.02);
  EXPECT_TRUE(inconsistencies(record, health, servo().facts()).empty());
}

// Its first angle is far from the last one of the file before.
TEST(ScaleFactors, TheAngleOfTheNextFileIsNoNoise) {
  RawLog raw = simulate_synthetic({.duration_s = 1.5});
  raw.u_alpha = raw.u_beta = {};
  Health health;
  const Record file = make_record(raw, servo().machine.n_p, health);
  Record both = file;
  both.append(file);
  EXPECT_GT(std::abs(file.theta_m.back() - file.theta_m.front()), 10);
  EXPECT_NEAR(scale_factors(both, servo().facts()).torque.cells,
              2 * scale_factors(file, servo().facts()).torque.cells, 10);
  EXPECT_TRUE(inconsistencies(both, health, servo().facts()).empty());
}

}  // namespace
}  // namespace twinrate
