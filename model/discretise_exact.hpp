// Exact solution of x' = A x + B u over one period T with u held, by the matrix exponential.
#pragma once
#include <Eigen/Core>
#include <Eigen/LU>
#include <unsupported/Eigen/MatrixFunctions>

namespace twinrate {

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
