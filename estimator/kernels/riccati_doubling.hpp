// Many steps of a Riccati recursion with constant matrices in about log2 of as many.
//
// One step, with X the covariance before the correction, A = F, G = H' R^-1 H and Q the process
// noise:
//
//   X <- A X (I + G X)^-1 A' + Q
//
// Two steps of a map are one step of the map
//
//   W  = (I + Q G)^-1
//   Q <- Q + A W Q A'
//   G <- G + A' G W A
//   A <- A W A
//
// So the maps of 1, 2, 4, 8 .. steps follow from each other, and X takes those of the binary digits
// of `steps`. When A has decayed to zero, X no longer depends on its first value and equals Q of
// that map. Source: Anderson and Moore, Optimal Filtering, 1979, section 6.7.
#pragma once
#include <Eigen/Core>
#include <Eigen/LU>

namespace twinrate::kernel {

// N, or a size up to MAX known at run time if N is Eigen::Dynamic.
template <int N, int MAX = N>
struct RiccatiMap {
  using Matrix = Eigen::Matrix<double, N, N, 0, MAX, MAX>;
  Matrix A, G, Q;

  Matrix one() const { return Matrix::Identity(A.rows(), A.cols()); }
  Matrix of(const Matrix& X) const {
    const Matrix XG = one() + X * G, W = XG.inverse();
    const Matrix AW = A * W, AWX = AW * X;
    return Q + AWX * A.transpose();
  }
  void double_up() {
    const Matrix QG = one() + Q * G, W = QG.inverse();
    const Matrix AW = A * W, GW = G * W, AWQ = AW * Q, GWA = GW * A, A_turned = A.transpose();
    Q += AWQ * A_turned;
    G += A_turned * GWA;
    A = (AW * A).eval();
  }
};

template <int N, int MAX>
auto riccati_steps(RiccatiMap<N, MAX> map, typename RiccatiMap<N, MAX>::Matrix X, int steps) {
  constexpr double kDiedAway = 1e-9;
  for (; steps > 0; steps >>= 1) {
    if (steps & 1) X = map.of(X);
    if (steps == 1) break;
    map.double_up();
    if (map.A.template lpNorm<Eigen::Infinity>() < kDiedAway) return map.Q;
  }
  return X;
}

}  // namespace twinrate::kernel
