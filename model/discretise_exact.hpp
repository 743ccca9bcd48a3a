// Exact solution of x' = A x + B u over one period T with u held, by the matrix exponential.
//
//   x(T)           = A_d x + B_d u
//   [A_d B_d; 0 I] = exp([A B; 0 0] T)
#pragma once
#include <Eigen/Core>

#include "model/matrix_exponential.hpp"

namespace twinrate {

template <int N, int M>
struct DiscreteModel {
  Eigen::Matrix<double, N, N> A;
  Eigen::Matrix<double, N, M> B;
};

template <int N, int M>
DiscreteModel<N, M> discretise_exact(const Eigen::Matrix<double, N, N>& A,
                                     const Eigen::Matrix<double, N, M>& B, double T) {
  SmallMatrix block = SmallMatrix::Zero(N + M, N + M);
  block.topLeftCorner<N, N>() = A * T;
  block.topRightCorner<N, M>() = B * T;
  const SmallMatrix e = matrix_exponential(block);
  return {e.topLeftCorner<N, N>(), e.topRightCorner<N, M>()};
}

}  // namespace twinrate
