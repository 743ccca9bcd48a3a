// The covariance of the sensorless filter as P = U D U' (U unit upper triangular, D diagonal), for
// arithmetic with few digits: P is never formed, so it cannot lose its symmetry or its sign.
//
// Time update, P^- = F P F' + Q:
//
//   W      = [F U, I]                  4 by 8
//   D_W    = diag(D, Q)
//   U, D   <- weighted Gram-Schmidt of the rows of W with the weights D_W             Thornton 1976
//
// Measurement update, one output after the other, y_j = x_j + noise of variance R_j:
//
//   f      = U' e_j
//   v      = D f
//   alpha  = R_j + f' v
//   k      = U v/alpha                                                     Bierman 1977, chapter V
//
// In float, at R = 1e-4 and 1e-8 and P_0 = 1e2, D stays positive and the angle stays within 1e-5
// rad of the filter in double. In float, (I - K H) P^- gets a negative variance at R = 1e-8; with
// little process noise (1e-8 of Dilys (22)) it loses the rotor. Joseph's form does neither
// (tests/estimator/kernels_test.cpp).
#pragma once
#include "estimator/kernels/ekf_sensorless_kernel.hpp"

namespace twinrate::kernel {

template <class T>
struct UdCovariance {
  T U[4][4];  // the diagonal is 1; it and the entries below it are not read
  T D[4];
};

// From a diagonal P.
template <class T>
UdCovariance<T> ud_from_diagonal(const T (&P_diag)[4]) {
  UdCovariance<T> P{};
  for (int i = 0; i < 4; ++i) P.U[i][i] = 1, P.D[i] = P_diag[i];
  return P;
}

// F U, row by row; F as in kernels/ekf_sensorless_kernel.hpp.
template <class T, class S>
void weigh_rows(const SensorlessConstants<S>& c, const SensorlessJacobian<T>& F,
                const UdCovariance<T>& P, T (&W)[4][8]) {
  for (int j = 0; j < 4; ++j) {
    const T u0 = j > 0 ? P.U[0][j] : T(1), u1 = j > 1 ? P.U[1][j] : T(j == 1);
    const T u2 = j > 2 ? P.U[2][j] : T(j == 2), u3 = T(j == 3);
    W[0][j] = u0 * c.d + F.g02 * u2 + F.g03 * u3;
    W[1][j] = u1 * c.d + F.g12 * u2 + F.g13 * u3;
    W[2][j] = u2;
    W[3][j] = u3 + u2 * c.T_s;
    for (int i = 0; i < 4; ++i) W[i][4 + j] = T(i == j);
  }
}

template <class T, class S>
UdCovariance<T> ud_propagate(const SensorlessConstants<S>& c, const SensorlessJacobian<T>& F,
                             const UdCovariance<T>& P, const S (&Q)[4]) {
  T W[4][8];
  weigh_rows(c, F, P, W);
  const T D_W[8] = {P.D[0], P.D[1], P.D[2], P.D[3], Q[0], Q[1], Q[2], Q[3]};
  UdCovariance<T> P_prior{};
  for (int j = 3; j >= 0; --j) {
    T weighted[8], D_j = 0;
    for (int k = 0; k < 8; ++k) weighted[k] = D_W[k] * W[j][k], D_j += weighted[k] * W[j][k];
    P_prior.D[j] = D_j;
    P_prior.U[j][j] = 1;
    for (int i = 0; i < j; ++i) {
      T u = 0;
      for (int k = 0; k < 8; ++k) u += weighted[k] * W[i][k];
      u = u / D_j;
      P_prior.U[i][j] = u;
      for (int k = 0; k < 8; ++k) W[i][k] -= u * W[j][k];
    }
  }
  return P_prior;
}

// Corrects P with output j and returns its gain k.
template <class T, class S>
void ud_correct(UdCovariance<T>& P, int output, S R_output, T (&k)[4]) {
  T alpha = R_output;
  for (int j = 0; j < 4; ++j) {
    const T f = j < output ? T(0) : j == output ? T(1) : P.U[output][j];
    const T v = P.D[j] * f, alpha_before = alpha;
    alpha += f * v;
    P.D[j] *= alpha_before / alpha;
    k[j] = v;
    const T lambda = -f / alpha_before;
    for (int i = 0; i < j; ++i) {
      const T u = P.U[i][j];
      P.U[i][j] = u + lambda * k[i];
      k[i] += v * u;
    }
  }
  for (T& k_i : k) k_i = k_i / alpha;
}

// Both outputs, and the gain that corrects with both at once:
//
//   K e_0 = k_0 - k_1 (k_0)_1
//   K e_1 = k_1
template <class T, class S>
Gain42<T> ud_gain(UdCovariance<T>& P, const S (&R)[2]) {
  T a[4], b[4];
  ud_correct(P, 0, R[0], a);
  ud_correct(P, 1, R[1], b);
  return {a[0] - b[0] * a[1], b[0], a[1] - b[1] * a[1], b[1],
          a[2] - b[2] * a[1], b[2], a[3] - b[3] * a[1], b[3]};
}

}  // namespace twinrate::kernel
