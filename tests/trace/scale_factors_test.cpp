// The scales of a log against the drive file where the angle is coarse or begins anew.
#include "trace/scale_factors.hpp"

#include <gtest/gtest.h>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/consistency.hpp"

namespace twinrate {
namespace {

// In a cell of 4 ms the rotor turns by a count or two. Two rounded ends add N = step^2/6 to the
// power S of the turns: least squares find S/(S + N) of psi_f.
TEST(ScaleFactors, ASlowCoarseEncoderAttenuatesNoMagnet) {
  constexpr int kCounts = 256;
  constexpr std::size_t kCell = 40;  // rows
  Health health;
  SyntheticDrive drive{.duration_s = 2, .counts = 1 << 24, .speeds = 0.04, .loads = 0.3};
  const RawLog fine = simulate_synthetic(drive);
  double S = 0, cells = 0;
  for (std::size_t k = 0; k + kCell < fine.size(); k += kCell, ++cells)
    S += std::pow(fine.theta_m[k + kCell] - fine.theta_m[k], 2);
  S /= cells;
  const double N = std::pow(kTwoPi / kCounts, 2) / 6;
  drive.counts = kCounts;
  const Record record = make_record(simulate_synthetic(drive), servo().machine.n_p, health);
  const ScaleFactors f = scale_factors(record, servo().facts());
  EXPECT_NEAR(f.psi_f.value, S / (S + N), 0.05);
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
