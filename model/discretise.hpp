// Discretisations of x' = f(x) over one period T: explicit Euler, classical Runge-Kutta 4, and the exact
// solution of x' = A x + B u (u held) by the matrix exponential.
#pragma once
#include <Eigen/Core>
#include <Eigen/LU>
#include <unsupported/Eigen/MatrixFunctions>

namespace twinrate {

enum class Prediction : int { kEuler = 0, kRk4 = 1, kExact = 2 };
inline constexpr const char* kPredictionNames[] = {"euler", "rk4", "exact"};

template <class X, class F>
X euler_step(const F& f, const X& x, double T) {
  return x + T * f(x);
}

template <class X, class F>
X rk4_step(const F& f, const X& x, double T) {
  const X k1 = f(x);
  const X k2 = f(X(x + 0.5 * T * k1));
  const X k3 = f(X(x + 0.5 * T * k2));
  const X k4 = f(X(x + T * k3));
  return x + T / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
}

template <int N, int M>
struct DiscreteModel {
  Eigen::Matrix<double, N, N> A;
  Eigen::Matrix<double, N, M> B;
};

// [A_d B_d; 0 I] = exp([A B; 0 0] T)
template <int N, int M>
DiscreteModel<N, M> discretise_exact(const Eigen::Matrix<double, N, N>& A,
                                     const Eigen::Matrix<double, N, M>& B, double T) {
  Eigen::Matrix<double, N + M, N + M> block = Eigen::Matrix<double, N + M, N + M>::Zero();
  block.template topLeftCorner<N, N>() = A * T;
  block.template topRightCorner<N, M>() = B * T;
  const Eigen::Matrix<double, N + M, N + M> e = block.exp();
  return {e.template topLeftCorner<N, N>(), e.template topRightCorner<N, M>()};
}

}  // namespace twinrate
