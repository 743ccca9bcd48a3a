#include "model/discretise.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <functional>

#include "model/discretise_exact.hpp"

namespace twinrate {
namespace {

using Vec2 = Eigen::Vector2d;

// A pendulum-like field with no special structure: x' = [x1, -sin x0 - 0.3 x1 x0].
Vec2 field(const Vec2& x) {
  return {x[1], -std::sin(x[0]) - 0.3 * x[1] * x[0]};
}

Vec2 integrate(const std::function<Vec2(const Vec2&, double)>& step, int steps) {
  Vec2 x(1.0, 0.4);
  for (int i = 0; i < steps; ++i) x = step(x, 1.0 / steps);
  return x;
}

// Slope of log(error) over log(step) between two step counts.
double order_of(const std::function<Vec2(const Vec2&, double)>& step, int coarse, int fine) {
  // Oracle: the midpoint rule, extrapolated twice from 2^11, 2^12 and 2^13 steps.
  const auto midpoint = [](const Vec2& x, double T) -> Vec2 {
    return x + T * field(x + 0.5 * T * field(x));
  };
  const Vec2 a = integrate(midpoint, 1 << 11), b = integrate(midpoint, 1 << 12),
             c = integrate(midpoint, 1 << 13);
  const Vec2 ab = (4 * b - a) / 3, bc = (4 * c - b) / 3, truth = (8 * bc - ab) / 7;
  const double error_coarse = (integrate(step, coarse) - truth).norm();
  const double error_fine = (integrate(step, fine) - truth).norm();
  return std::log(error_coarse / error_fine) / std::log(static_cast<double>(fine) / coarse);
}

TEST(EulerStep, ConvergesWithOrderOne) {
  const auto step = [](const Vec2& x, double T) { return euler_step<Vec2>(field, x, T); };
  EXPECT_NEAR(order_of(step, 100, 200), 1.0, 0.05);
}

TEST(Rk4Step, ConvergesWithOrderFour) {
  const auto step = [](const Vec2& x, double T) { return rk4_step<Vec2>(field, x, T); };
  EXPECT_NEAR(order_of(step, 8, 16), 4.0, 0.25);
}

TEST(EulerStep, IsTheFirstTwoTermsOfTheSeries) {
  const Vec2 x(0.3, -2);
  EXPECT_EQ(euler_step<Vec2>(field, x, 0.01), Vec2(x + 0.01 * field(x)));
}

TEST(Rk4Step, IntegratesAPolynomialOfDegreeThreeInTimeExactly) {
  // x = [t, t^4/4 ..]: x1' = x0^3 with x0' = 1.
  const auto f = [](const Vec2& x) { return Vec2(1, x[0] * x[0] * x[0]); };
  EXPECT_NEAR(rk4_step<Vec2>(f, Vec2(0, 0), 2.0)[1], 4.0, 1e-14);
}

TEST(DiscretiseExact, FirstOrderLagHasItsClosedForm) {
  // x' = -a x + b u
  const double a = 2400, b = 2000, T = 2e-4;
  const auto d =
      discretise_exact<1, 1>(Eigen::Matrix<double, 1, 1>(-a), Eigen::Matrix<double, 1, 1>(b), T);
  EXPECT_NEAR(d.A(0, 0), std::exp(-a * T), 1e-15);
  EXPECT_NEAR(d.B(0, 0), b / a * (1 - std::exp(-a * T)), 1e-14);
}

TEST(DiscretiseExact, ADampedOscillatorHasItsClosedForm) {
  const double s = 3, w = 40, T = 0.05;  // eigenvalues -s +- j w
  Eigen::Matrix2d A;
  A << -s, w, -w, -s;
  const auto d = discretise_exact<2, 1>(A, Eigen::Vector2d(1, 0), T);
  Eigen::Matrix2d expected;
  expected << std::cos(w * T), std::sin(w * T), -std::sin(w * T), std::cos(w * T);
  EXPECT_NEAR((d.A - std::exp(-s * T) * expected).norm(), 0, 1e-14);
  // B_d = A^-1 (A_d - I) B
  EXPECT_NEAR(
      (d.B - A.inverse() * (d.A - Eigen::Matrix2d::Identity()) * Eigen::Vector2d(1, 0)).norm(), 0,
      1e-14);
}

TEST(DiscretiseExact, AnIntegratorNeedsNoInverse) {
  // Double integrator: A is singular and nilpotent.
  Eigen::Matrix2d A;
  A << 0, 1, 0, 0;
  const auto d = discretise_exact<2, 1>(A, Eigen::Vector2d(0, 1), 0.5);
  EXPECT_NEAR(d.A(0, 1), 0.5, 1e-15);
  EXPECT_NEAR(d.B(0, 0), 0.125, 1e-15);
  EXPECT_NEAR(d.B(1, 0), 0.5, 1e-15);
}

TEST(DiscretiseExact, AgreesWithFineIntegrationOfAStiffMachine) {
  Eigen::Matrix3d A;
  A << -2400, 400, 0, -400, -2400, -14e3 / 250, 0, 4200, -1;
  Eigen::Matrix<double, 3, 2> B;
  B << 2000, 0, 0, 2000, 0, 0;
  const Eigen::Vector2d u(3, -5);
  Eigen::Vector3d x(0.5, -1, 80), x_exact = x;
  const auto d = discretise_exact<3, 2>(A, B, 2e-4);
  x_exact = d.A * x + d.B * u;
  const auto rate = [&](const Eigen::Vector3d& s) { return Eigen::Vector3d(A * s + B * u); };
  for (int i = 0; i < 1000; ++i) x = rk4_step<Eigen::Vector3d>(rate, x, 2e-7);
  EXPECT_NEAR((x - x_exact).norm(), 0, 1e-10);
}

}  // namespace
}  // namespace twinrate
