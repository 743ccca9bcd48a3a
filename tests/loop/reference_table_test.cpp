// docs/theory/two-rate-ekf.md: the figures of an independent implementation at 400 rad/s, f_s 5
// kHz, preset dilys2021.
#include <gtest/gtest.h>

#include "tests/loop/closed_loop.hpp"

namespace twinrate::test {
namespace {

struct Row {
  const char* prediction;
  int n;
  double angle_error_rms_deg;
};

void PrintTo(const Row& row, std::ostream* out) {
  *out << row.prediction << " n = " << row.n << ", " << row.angle_error_rms_deg << " deg";
}

class ReferenceTable : public testing::TestWithParam<Row> {};

TEST_P(ReferenceTable, AngleErrorRmsIsWithinFifteenPercent) {
  const Row row = GetParam();
  const Figures figures = run(
      "dilys2021",
      {fmt::format("rates.n={}", row.n), fmt::format("estimator.prediction={}", row.prediction)});
  EXPECT_TRUE(figures.held());
  EXPECT_NEAR(degrees(figures.angle_error_rms), row.angle_error_rms_deg,
              0.15 * row.angle_error_rms_deg);
  EXPECT_NEAR(figures.speed_mean, 100, 0.5);
}

constexpr Row kTable[] = {{"euler", 1, 2.51},  {"euler", 2, 2.51},  {"euler", 4, 2.51},
                          {"euler", 5, 2.51},  {"euler", 10, 2.53}, {"euler", 11, 2.55},
                          {"euler", 12, 2.68}, {"rk4", 1, 0.25},    {"rk4", 2, 0.25},
                          {"rk4", 4, 0.26},    {"rk4", 5, 0.26},    {"rk4", 10, 0.39},
                          {"rk4", 11, 0.55}};
INSTANTIATE_TEST_SUITE_P(Dilys2021, ReferenceTable, testing::ValuesIn(kTable), [](const auto& i) {
  return fmt::format("{}_n{}", i.param.prediction, i.param.n);
});

TEST(ReferenceRun, EulerLagsByHalfASamplingPeriodOfRotation) {
  // The bias of explicit Euler: omega_e T_s/2 = 400 * 200e-6/2 rad = 2.29 deg dominates the error.
  ClosedLoop loop(load("dilys2021", {"rates.n=1", "sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0"}));
  const Figures figures = run(loop);
  EXPECT_NEAR(degrees(figures.angle_error_rms), 2.29, 0.30);
  EXPECT_LT(degrees(figures.angle_error_max), 3.0);
}

TEST(ReferenceRun, Rk4AtTwelveIsTheBoundaryAndSwingsFarFromTheEulerFigure) {
  const Figures figures = run("dilys2021", {"rates.n=12", "estimator.prediction=rk4"});
  EXPECT_GT(degrees(figures.angle_error_rms), 15);
  EXPECT_LT(degrees(figures.angle_error_rms), 25);
}

TEST(ReferenceRun, ThirteenIsLostWithEitherPrediction) {
  for (const char* prediction : {"euler", "rk4"}) {
    const Figures figures = run("dilys2021", {"rates.n=13", "run.settle_s=0.5",
                                              fmt::format("estimator.prediction={}", prediction)});
    EXPECT_FALSE(figures.held()) << prediction;
    EXPECT_GT(degrees(figures.angle_error_max), 150) << prediction;
  }
}

TEST(AngleVariance, LiesBetween039And041UpToFiveTicksAGain) {
  for (int n : {1, 2, 4, 5}) {
    const Figures figures = run("dilys2021", {fmt::format("rates.n={}", n), "run.settle_s=1.0"});
    EXPECT_GE(figures.P44_min, 0.39) << "n = " << n;
    EXPECT_LE(figures.P44_max, 0.41) << "n = " << n;
  }
}

TEST(AngleVariance, GrowsTo045AtTwelveTicksAGain) {
  const Figures figures = run("dilys2021", {"rates.n=12", "run.settle_s=1.0"});
  EXPECT_GE(figures.P44_min, 0.41);
  EXPECT_GE(figures.P44_max, 0.43);
  EXPECT_LE(figures.P44_max, 0.45);
}

TEST(CovarianceForm, JosephAndPaperGiveTheSameRun) {
  // Without the ADC, which can round a difference in the last bit to a whole count.
  const double joseph =
      run("dilys2021", {"estimator.covariance=joseph", "sensors.i_lsb_A=0"}).angle_error_rms;
  const double paper =
      run("dilys2021", {"estimator.covariance=paper", "sensors.i_lsb_A=0"}).angle_error_rms;
  EXPECT_NEAR(paper, joseph, 1e-8 * joseph);
}

TEST(Run, RepeatsItselfBitForBitAndChangesWithTheSeed) {
  ClosedLoop first(load("dilys2021")), again(load("dilys2021")),
      other(load("dilys2021", {"run.seed=2"}));
  for (int k = 0; k < 2000; ++k) {
    first.tick();
    again.tick();
    other.tick();
  }
  EXPECT_EQ(first.truth().theta_m, again.truth().theta_m);
  EXPECT_EQ(first.estimate().x_hat, again.estimate().x_hat);
  EXPECT_NE(first.estimate().x_hat, other.estimate().x_hat);
}

}  // namespace
}  // namespace twinrate::test
