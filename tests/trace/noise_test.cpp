// The noise model: what the sensors make of it, whatever the columns could explain.
#include "trace/noise.hpp"

#include <gtest/gtest.h>

#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

Eigen::VectorXd white(std::uint64_t stream, Eigen::Index n) {
  Eigen::VectorXd x(n);
  for (Eigen::Index k = 0; k < n; ++k) x[k] = normal(7, stream, static_cast<std::uint64_t>(k));
  return x;
}

TEST(Unexplained, LeavesWhatNoColumnHolds) {
  constexpr Eigen::Index n = 6000;
  const Eigen::VectorXd a = white(1, n), b = white(2, n), noise = white(3, n);
  Unexplained by;
  by.look_at({&a, &b});
  const Eigen::VectorXd y = 40 * a - 3 * b + noise;
  EXPECT_LT((by(y, 2) - noise).norm(), 0.05 * noise.norm());
  EXPECT_NEAR(by(y, 1).norm() / (noise - 3 * b).norm(), 1, 0.02);
}

TEST(Unexplained, KeepsNoProductOfAColumnThatChanged) {
  constexpr Eigen::Index n = 6000;
  const Eigen::VectorXd a = white(1, n), b = white(2, n), d = white(4, n), e = white(5, n);
  const Eigen::VectorXd y = 3 * a + 2 * d + white(3, n);
  Unexplained kept, fresh;
  kept.look_at({&a, &b, &e});
  kept.look_at({&a, &d, &e});
  fresh.look_at({&a, &d, &e});
  EXPECT_LT((kept(y, 3) - fresh(y, 3)).norm(), 1e-9 * y.norm());
}

// Both axes of the voltage see the same sensors. In a slow run i_d is nothing but noise, and so is
// what the columns of an asymmetry have in common.
TEST(NoiseFit, IsThatOfTheSensorsInASlowRunToo) {
  for (const bool slow : {false, true}) {
    Health health;
    const Record record = make_record(simulate_synthetic({.slow = slow}), 3, health);
    const DriveFacts facts = servo().facts();
    const Equations equations(record, facts);
    const std::vector<char> moving = moving_rows(equations);
    const Sampler sampler(record, moving, held_out_rows(record, 0.25, 3));
    const Record noisier = add_noise(record, facts, moving, health.i_lsb);
    const Equations noisier_equations(noisier, facts);
    const Chain chain(equations, noisier_equations, sampler);
    const Dictionary dictionary{.sampled = make_candidates(chain), .whitened = {}};
    const NoiseModel noise = NoiseFit()(chain, chain.residual({}), dictionary);
    EXPECT_NEAR(noise.d.rms() / noise.q.rms(), 1, 0.15) << (slow ? "slow" : "fast");
    EXPECT_NEAR(noise.scale_d, 1, 0.2);
  }
}

}  // namespace
}  // namespace twinrate
