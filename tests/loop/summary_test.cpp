// analysis/summary.hpp against the independent figures of closed_loop.hpp.
#include "analysis/summary.hpp"

#include <gtest/gtest.h>

#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

RunLog record(ClosedLoop& loop) {
  RunLog log;
  for (std::int64_t k = 0; k < loop.drive().steps(); ++k) {
    loop.tick();
    log.measurement.push_back(loop.measurement());
    log.truth.push_back(loop.truth());
    log.estimate.push_back(loop.estimate());
    log.reference.push_back(loop.reference());
    log.command.push_back(loop.command());
    if (is_snapshot(k, loop.drive().rates.n)) log.gain.push_back(loop.gain());
  }
  return log;
}

class SummaryFigures : public testing::TestWithParam<int> {};

TEST_P(SummaryFigures, AreThoseOfTheRun) {
  // A drive that loses synchronism switches off before the window, and its estimate agrees with the
  // rotor at rest. Here it runs on.
  const Overrides overrides{fmt::format("rates.n={}", GetParam()), "machine.i_trip_A=1000",
                            "safety.watch_sensors=false"};
  ClosedLoop recorded(load("dilys2021", overrides)), again(load("dilys2021", overrides));
  const Summary summary = summarise(record(recorded), recorded.drive());
  const Figures figures = run(again);
  ASSERT_TRUE(summary.locked && summary.angle_error_rms && summary.angle_error_max);
  EXPECT_EQ(*summary.locked, figures.locked);
  EXPECT_EQ(*summary.locked, GetParam() < 13);
  EXPECT_NEAR(*summary.angle_error_rms, figures.angle_error_rms, 1e-4 * figures.angle_error_rms);
  EXPECT_NEAR(*summary.angle_error_max, figures.angle_error_max, 1e-9);
  EXPECT_EQ(summary.steps, 10000);
  EXPECT_EQ(summary.late_gains, 0);
  // Ticks 0..9999, gains of the snapshots 0, n, .. that were old enough to be used.
  EXPECT_EQ(summary.gains_used, (9999 / GetParam() * GetParam() - GetParam()) / GetParam() + 1);
}

INSTANTIATE_TEST_SUITE_P(N, SummaryFigures, testing::Values(1, 5, 12, 13));

}  // namespace
}  // namespace twinrate::test
