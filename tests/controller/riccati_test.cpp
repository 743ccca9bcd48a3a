#include "controller/riccati.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

namespace twinrate {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// The q axis of the Niewiara drive: widely spread poles and a free integrator.
struct Plant {
  MatrixXd A = MatrixXd::Zero(3, 3), B = MatrixXd::Zero(3, 1);
  Plant() {
    A << -82.677, 0, 0, 129.545, 0, 0, 0, 1, 0;
    B(0, 0) = 9267.7;
  }
};

DiscreteLqrProblem niewiara_problem(double T_s = 1e-4) {
  const Plant plant;
  return discretise_cost(plant.A, plant.B, Eigen::Vector3d(5.55e-3, 1.35e-4, 17.7).asDiagonal(),
                         MatrixXd::Identity(1, 1), T_s);
}

TEST(DiscretiseCost, EqualsTheIntegralOverOnePeriod) {
  const Plant plant;
  const VectorXd x0 = Eigen::Vector3d(0.7, -0.3, 0.02);
  const double u = 0.4, T_s = 1e-3;
  const MatrixXd Q = Eigen::Vector3d(2, 3, 500).asDiagonal();
  const auto p = discretise_cost(plant.A, plant.B, Q, MatrixXd::Constant(1, 1, 1.5), T_s);
  // Midpoint rule over the exact-enough fine solution.
  constexpr int kSteps = 200000;
  const double dt = T_s / kSteps;
  VectorXd x = x0;
  double cost = 0;
  for (int i = 0; i < kSteps; ++i) {
    const VectorXd mid = x + 0.5 * dt * (plant.A * x + plant.B * u);
    cost += dt * (mid.dot(Q * mid) + 1.5 * u * u);
    x += dt * (plant.A * mid + plant.B * u);
  }
  const double closed = x0.dot(p.Q * x0) + 2 * u * x0.dot(p.N.col(0)) + u * u * p.R(0, 0);
  EXPECT_NEAR(closed, cost, 1e-7 * cost);
  EXPECT_LT((p.A * x0 + p.B * u - x).norm(), 1e-8 * x.norm());
}

TEST(Riccati, DoublingAgreesWithValueIteration) {
  const DiscreteLqrProblem p = niewiara_problem();
  const RiccatiSolution s = solve_riccati(p);
  ASSERT_TRUE(s.converged);
  MatrixXd X = MatrixXd::Zero(3, 3);  // oracle: value iteration backwards over the horizon
  for (int i = 0; i < 20000; ++i) {
    const MatrixXd S = p.A.transpose() * X * p.B + p.N;
    X = (p.Q + p.A.transpose() * X * p.A -
         S * (p.R + p.B.transpose() * X * p.B).inverse() * S.transpose())
            .eval();
  }
  EXPECT_LT((s.X - X).norm(), 1e-8 * X.norm());
  EXPECT_LT(s.iterations, 20);
}

TEST(Riccati, ResidualIsRoundingAndTheLoopIsStable) {
  for (const double T_s : {1e-5, 1e-4, 1e-3}) {
    const DiscreteLqrProblem p = niewiara_problem(T_s);
    const RiccatiSolution s = solve_riccati(p);
    EXPECT_TRUE(s.converged) << T_s;
    EXPECT_LT(s.residual, 1e-10) << T_s;
    for (const auto& z : closed_loop_poles(p.A, p.B, s.K)) EXPECT_LT(std::abs(z), 1) << T_s;
  }
}

TEST(Riccati, ReportsAnUnstableStateThatIsNotObservableInTheCost) {
  DiscreteLqrProblem p;
  p.A = MatrixXd::Constant(1, 1, 1.0);  // an integrator without cost
  p.B = MatrixXd::Constant(1, 1, 0.1);
  p.Q = p.N = MatrixXd::Zero(1, 1);
  p.R = MatrixXd::Identity(1, 1);
  EXPECT_FALSE(solve_riccati(p).converged);
  p.Q(0, 0) = 1e-3;
  EXPECT_TRUE(solve_riccati(p).converged);
}

TEST(Margins, OfAnIntegratorWithDelayAreTheClosedForm) {
  // L = (k/z-1) z^-1 with k = w T: phase margin 90 deg - 1.5 w T, gain margin where the phase is
  // -180 deg: |z - 1| = 2 sin(wT/2) with 1.5 wT = 90 deg.
  const double T_s = 1e-3;
  const MatrixXd A = MatrixXd::Identity(1, 1), B = MatrixXd::Constant(1, 1, T_s);
  const MatrixXd K = MatrixXd::Constant(1, 1, 100.0);
  const Margins m = margins(A, B, K, 1, T_s);
  const double w = 2 / T_s * std::asin(0.05);
  EXPECT_NEAR(m.crossover_rad_s, w, 0.01 * w);
  EXPECT_NEAR(m.phase_rad, std::acos(0.0) - 1.5 * w * T_s, 0.01);
  EXPECT_NEAR(m.gain_up, 2 * std::sin(std::acos(0.0) / 3) / (100 * T_s), 0.02);
  EXPECT_EQ(m.gain_down, 0);
}

// Three integrators one behind the other are stable in a range of gains: at its lower end a
// closed-loop pole is on the unit circle.
TEST(Margins, OfThreeIntegratorsHaveALowerGainToo) {
  DiscreteLqrProblem p;
  constexpr double T = 0.01;
  p.A = MatrixXd::Identity(3, 3);
  p.A(0, 1) = p.A(1, 2) = T;
  p.A(0, 2) = T * T / 2;
  p.B = MatrixXd::Zero(3, 1);
  p.B << T * T * T / 6, T * T / 2, T;
  p.Q = MatrixXd::Identity(3, 3);
  p.N = MatrixXd::Zero(3, 1);
  p.R = MatrixXd::Identity(1, 1);
  const MatrixXd K = solve_riccati(p).K;
  const Margins m = margins(p.A, p.B, K, 0, T);
  EXPECT_GT(m.gain_down, 0.05);
  EXPECT_LT(m.gain_down, 0.5);
  const auto stable = [&](double gain) {
    for (const auto& z : closed_loop_poles(p.A, p.B, gain * K))
      if (std::abs(z) >= 1) return false;
    return true;
  };
  EXPECT_TRUE(stable(1.02 * m.gain_down));
  EXPECT_FALSE(stable(0.98 * m.gain_down));
}

}  // namespace
}  // namespace twinrate
