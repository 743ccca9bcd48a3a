// The steps that are counted, and the count itself where the images and the emulator are.
#include "embedded/instruction_counts.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "embedded/fixed_estimator.hpp"
#include "firmware/cortex_m3/ekf_matrix.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::instruction_counts_test {
namespace {

using N = m3::Checked32;
using Q = m3::Format32;

int largest_difference(std::initializer_list<std::pair<N::Word, N::Word>> pairs) {
  int largest = 0;
  for (const auto& [a, b] : pairs) largest = std::max(largest, std::abs(a.value() - b.value()));
  return largest;
}

// What is compared in the table computes the same: 2000 steps of both filters while the rotor turns.
TEST(MatrixFilter, EqualsTheSimplifiedOneUpToRounding) {
  Config config = load_drive("dilys2021", {"rates.n=1"});
  const m3::Settings s = fixed_settings(config);
  m3::matrix::Filter<N> f;
  m3::matrix::start(f, s.step, s.covariance);
  m3::Covariance<N> P{};
  P.m00 = P.m11 = N::Cell(s.covariance.P0[0]);
  P.m22 = N::Cell(s.covariance.P0[2]), P.m33 = N::Cell(s.covariance.P0[3]);
  m3::State<N> x;
  m3::Clamps clamps;
  x.omega = N::Word(m3::to_raw(400, m3::kSpeedRawLog2));
  f.x[2] = x.omega;
  for (int k = 0; k < 2000; ++k) {
    const auto at = m3::unit_vector<N>(x.theta);
    const m3::Pair<N> u{at.cos >> 5, at.sin >> 5}, y{at.sin >> 8, -(at.cos >> 8)};
    f.at = at;
    f.u[0] = u.alpha, f.u[1] = u.beta, f.y[0] = y.alpha, f.y[1] = y.beta;
    const auto F = m3::jacobian<N, Q>(s.covariance, x.omega, at);
    const auto P_prior = m3::propagate<N, Q>(s.covariance, F, P);
    const auto K = m3::gain<N, Q>(s.covariance, P_prior);
    P = m3::posterior<N, Q>(s.covariance, P_prior, K, clamps);
    const auto prior = m3::predict<N>(s.step, x, at, u);
    x = m3::correct<N, Q>(s.step, prior, K, m3::innovation<N>(prior, y), clamps);
    m3::matrix::jacobian(f);
    m3::matrix::propagate(f);
    m3::matrix::gain(f);
    m3::matrix::posterior(f, s.covariance, clamps);
    m3::matrix::predict(f);
    m3::matrix::correct(f);
    ASSERT_LT(largest_difference({{P.m00, f.P[0]}, {P.m13, f.P[7]}, {P.m22, f.P[10]}}), 400) << k;
    ASSERT_LT(largest_difference({{K.k00, f.K[0]}, {K.k21, f.K[5]}, {K.k30, f.K[6]}}), 12000) << k;
    f.x[0] = x.i_alpha, f.x[1] = x.i_beta, f.x[2] = x.omega;  // no drift of one from the other
    f.x[3] = N::Word(static_cast<int>(x.theta));
  }
}

TEST(Cycles, AreThoseOfTheClasses) {
  EXPECT_EQ(cycles_of("smull", "r0, r1, r2, r3").high, 5);
  EXPECT_EQ(cycles_of("smlal", "r0, r1, r2, r3").low, 4);
  EXPECT_EQ(cycles_of("push", "{r4, r5, lr}").low, 4);
  EXPECT_EQ(cycles_of("ldmia.w", "sp!, {r4, pc}").high, 3);
  EXPECT_EQ(cycles_of("sdiv", "r0, r1, r2").high, 12);
  EXPECT_EQ(cycles_of("ldr.w", "r0, [r1]").high, 2);
  EXPECT_EQ(cycles_of("itt", "gt").low, 0);
  EXPECT_EQ(cycles_of("adds", "r0, r1").high, 1);
}

// The counts in the tree are those of the images that this build made.
TEST(Count, OfTheEmulatorIsTheOneInTheTree) {
  if (const std::string why = why_no_cortex(); !why.empty()) GTEST_SKIP() << why;
  const CortexCounts counts = count_instructions();  // throws where SysTick and plugin differ
  std::ifstream file(TWINRATE_SOURCE_DIR "/bench/results/cortex_m3.json");
  const auto kept = nlohmann::json::parse(file);
  double generic = 0, simplified = 0;
  for (const StepCount& s : counts.steps) {
    if (kept.at("compiler") == counts.compiler) {
      EXPECT_EQ(kept.at("steps").at(s.name).at("instructions"), s.instructions) << s.name;
    }
    if (s.name.starts_with("matrix_O2.")) generic += s.instructions;
    for (const char* step : {"F", "P_prior", "K", "P", "x_prior", "x"})
      if (s.name == std::string("simplified.") + step) simplified += s.instructions;
    EXPECT_LE(s.cycles_low, s.cycles_high) << s.name;
    EXPECT_GT(s.cycles_low, s.instructions * 0.9) << s.name;
  }
  EXPECT_GE(generic / simplified, 8);
  EXPECT_LE(generic / simplified, 12);
}

}  // namespace
}  // namespace twinrate::instruction_counts_test
