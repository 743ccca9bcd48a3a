// What the samples show: lost, repeated and clipped rows, beside what the model lacks.
#include <gtest/gtest.h>

#include "tests/trace/traced_drive.hpp"

namespace twinrate {
namespace {

using Columns = std::vector<std::vector<double>*>;

Columns columns_of(RawLog& raw) {
  return {&raw.t,      &raw.i_a,     &raw.i_b,  &raw.i_c,   &raw.u_alpha,
          &raw.u_beta, &raw.theta_m, &raw.v_dc, &raw.T_load};
}

// One row of 83 is lost.
RawLog lossy_log(RawLog raw) {
  for (std::vector<double>* column : columns_of(raw)) {
    std::size_t row = 0;
    std::erase_if(*column, [&](double) { return row++ % 83 == 7; });
  }
  return raw;
}

TEST(Tracer, FindsLostAndRepeatedRowsInTheSamples) {
  RawLog raw = simulate_synthetic({});
  const RawLog lossy = lossy_log(raw);
  Health health;
  make_record(lossy, 3, health);
  EXPECT_NEAR(health.missing_share, 1.0 / 83, 5e-4);
  EXPECT_LT(health.stale_share, 1e-4);
  for (std::vector<double>* column : columns_of(raw))
    if (column != &raw.t)
      for (std::size_t k = 50; k < column->size(); k += 50) (*column)[k] = (*column)[k - 1];
  Health repeated;
  make_record(raw, 3, repeated);
  EXPECT_NEAR(repeated.stale_share, 1.0 / 50, 1e-3);
  EXPECT_EQ(repeated.missing_share, 0);
}

TEST(Tracer, LostRowsAreTheOnlyFindingWhereTheModelHoldsBesideThem) {
  const TraceResult r = trace_of(lossy_log(simulate_synthetic({.duration_s = 4})));
  EXPECT_EQ(kinds(r), Names{"missing_samples"}) << r.sentence;
  EXPECT_EQ(r.verdict, "traced") << r.sentence;
}

// The coarse angle drowns the torque: of the model this log says no more than that rows are lost.
TEST(Tracer, LostRowsAreNoTraceWhereTheModelPredictsNoBetterThanNoChange) {
  RawLog raw = lossy_log(simulate_synthetic({.duration_s = 4, .slow = true, .counts = 1024}));
  raw.u_alpha.clear();
  raw.u_beta.clear();
  const TraceResult r = trace_of(raw);
  EXPECT_EQ(kinds(r), Names{"missing_samples"}) << r.sentence;
  ASSERT_TRUE(r.mechanical) << r.sentence;
  EXPECT_NEAR(r.mechanical->after.held_out / r.mechanical->no_change, 1, 0.02);
  EXPECT_EQ(r.verdict, "ambiguous") << r.sentence;
  EXPECT_TRUE(r.sentence.starts_with("Cannot tell")) << r.sentence;
}

TEST(Tracer, LostRowsAreNoTraceWhereMoreThanNoiseIsLeft) {
  SyntheticDrive drive{.duration_s = 4};
  drive.extra_load = [](double t, double, double) {
    return 0.15 * normal(5, 1, static_cast<std::uint64_t>(1000 * t));
  };
  const TraceResult r = trace_of(lossy_log(simulate_synthetic(drive)));
  EXPECT_EQ(kinds(r), Names{"missing_samples"}) << r.sentence;
  EXPECT_EQ(r.verdict, "unexplained") << r.sentence;
}

TEST(Tracer, AClippedCurrentIsNotACoarseOne) {
  RawLog raw = simulate_synthetic({});
  Health whole;
  make_record(raw, 3, whole);
  EXPECT_EQ(whole.i_limit, 0);
  EXPECT_NEAR(whole.i_lsb, 0.009765625, 1e-6);
  for (std::vector<double>* c : {&raw.i_a, &raw.i_b})
    for (double& i : *c) i = std::clamp(i, -0.9, 0.9);
  Health clipped;
  make_record(raw, 3, clipped);
  EXPECT_NEAR(clipped.i_limit, 0.9, 1e-9);
  EXPECT_GT(clipped.clipped_share, 0.05);
  RawLog coarse = simulate_synthetic({.lsb = 0.2});
  Health stepped;
  make_record(coarse, 3, stepped);
  EXPECT_EQ(stepped.i_limit, 0);
  EXPECT_NEAR(stepped.i_lsb, 0.2, 1e-6);
  EXPECT_TRUE(stepped.coarse(7));
  EXPECT_FALSE(whole.coarse(7));
}

}  // namespace
}  // namespace twinrate
