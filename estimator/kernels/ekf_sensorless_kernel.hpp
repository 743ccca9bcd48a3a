// The sensorless filter written out by hand: the equations of estimator/ekf_sensorless.hpp with
// their zeros, their symmetry and H = [I 0] used.
//
// Prediction over T_s, with h(theta) = [sin theta; -cos theta] and the angle theta_0, theta_m,
// theta_1 at the beginning, in the middle and at the end of T_s:
//
//   i^-       = r i + g u + omega_e (e_0 h(theta_0) + e_m h(theta_m) + e_1 h(theta_1))         (13)
//   omega_e^- = omega_e                                                                        (13)
//   theta_e^- = theta_e + T_s omega_e                                                          (13)
//
// Euler: e_m = e_1 = 0. Runge-Kutta 4 of the linear current equation has this form, too.
//
// Correction:
//
//   x = x^- + K (y - [I 0] x^-)                                                                (16)
//
// Background:
//
//         [d   0   g02  g03]
//   F   = [0   d   g12  g13]                                                                   (11)
//         [0   0   1    0  ]
//         [0   0   T_s  1  ]
//   P^- = F P F' + Q                                                                           (14)
//   S   = P^-_(0..1)(0..1) + R
//   K   = P^- H' S^-1                                                                          (17)
//   P_ij = K_ij R_j                           for j = 0, 1: 7 of the 10 entries, from P H' = K R
//   P_ij = P^-_ij - K_i0 P^-_0j - K_i1 P^-_1j     the other three                              (15)
//
// T: number or lanes (symmetric.hpp). S (template parameter): the scalar of the constants.
// Source: Dilys 2021, equation numbers.
#pragma once
#include "estimator/kernels/symmetric.hpp"

namespace twinrate::kernel {

// Constants of the machine and T_s, the same for all lanes.
template <class S>
struct SensorlessConstants {
  S T_s;
  S d;              // 1 - T_s R_s/L, diagonal of F
  S b;              // T_s psi_f/L
  S r, g;           // prediction: share of the old current, of the voltage
  S e_0, e_m, e_1;  // prediction: shares of the EMF at begin, middle and end
};

template <class S>
SensorlessConstants<S> sensorless_euler(S R_s, S L, S psi_f, S T_s) {
  const S d = 1 - T_s * R_s / L, b = T_s * psi_f / L;
  return {T_s, d, b, d, T_s / L, b, 0, 0};
}

// Runge-Kutta 4 of i' = -a i + v(t):
//
//   i(T_s) = r i(0) + T_s (w_0 v(0) + w_m v(T_s/2) + w_1 v(T_s))
template <class S>
SensorlessConstants<S> sensorless_rk4(S R_s, S L, S psi_f, S T_s) {
  const S z = -T_s * R_s / L, b = T_s * psi_f / L;
  const S r = 1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)));
  const S w_0 = (1 + z * (1 + z / 2 * (1 + z / 2))) / 6;
  const S w_m = (4 + z * (2 + z / 2)) / 6, w_1 = S(1) / 6;
  return {T_s, 1 + z, b, r, T_s / L * (w_0 + w_m + w_1), b * w_0, b * w_m, b * w_1};
}

template <class T>
struct SensorlessState {
  T i_alpha, i_beta, omega_e, theta_e;
};
template <class T>
struct Stationary {
  T alpha, beta;
};
// sin and cos of an electrical angle.
template <class T>
struct UnitVector {
  T sin, cos;
};

template <class T, class S>
SensorlessState<T> predict_euler(const SensorlessConstants<S>& c, const SensorlessState<T>& x,
                                 const UnitVector<T>& at_0, const Stationary<T>& u) {
  const T emf = x.omega_e * c.e_0;
  return {x.i_alpha * c.r + u.alpha * c.g + emf * at_0.sin,
          x.i_beta * c.r + u.beta * c.g - emf * at_0.cos, x.omega_e, x.theta_e + x.omega_e * c.T_s};
}

template <class T, class S>
SensorlessState<T> predict_rk4(const SensorlessConstants<S>& c, const SensorlessState<T>& x,
                               const UnitVector<T>& at_0, const UnitVector<T>& at_mid,
                               const UnitVector<T>& at_1, const Stationary<T>& u) {
  const T sine = at_0.sin * c.e_0 + at_mid.sin * c.e_m + at_1.sin * c.e_1;
  const T cosine = at_0.cos * c.e_0 + at_mid.cos * c.e_m + at_1.cos * c.e_1;
  return {x.i_alpha * c.r + u.alpha * c.g + x.omega_e * sine,
          x.i_beta * c.r + u.beta * c.g - x.omega_e * cosine, x.omega_e,
          x.theta_e + x.omega_e * c.T_s};
}

template <class T>
Stationary<T> innovation(const SensorlessState<T>& x_prior, const Stationary<T>& y) {
  return {y.alpha - x_prior.i_alpha, y.beta - x_prior.i_beta};
}

template <class T>
SensorlessState<T> correct(const SensorlessState<T>& x_prior, const Gain42<T>& K,
                           const Stationary<T>& innov) {
  return {x_prior.i_alpha + (K.k00 * innov.alpha + K.k01 * innov.beta),
          x_prior.i_beta + (K.k10 * innov.alpha + K.k11 * innov.beta),
          x_prior.omega_e + (K.k20 * innov.alpha + K.k21 * innov.beta),
          x_prior.theta_e + (K.k30 * innov.alpha + K.k31 * innov.beta)};
}

// The four entries of F that change: F = I + F_c T_s at (omega_e, theta_e).
template <class T>
struct SensorlessJacobian {
  T g02, g03, g12, g13;
};
template <class T, class S>
SensorlessJacobian<T> jacobian(const SensorlessConstants<S>& c, const T& omega_e,
                               const UnitVector<T>& at) {
  const T g02 = at.sin * c.b, minus_g12 = at.cos * c.b;
  return {g02, omega_e * minus_g12, -minus_g12, omega_e * g02};
}

template <class T, class S>
Symmetric4<T> propagate(const SensorlessConstants<S>& c, const SensorlessJacobian<T>& F,
                        const Symmetric4<T>& P, const S (&Q)[4]) {
  const T fp00 = P.m00 * c.d + F.g02 * P.m02 + F.g03 * P.m03;  // F P
  const T fp01 = P.m01 * c.d + F.g02 * P.m12 + F.g03 * P.m13;
  const T fp02 = P.m02 * c.d + F.g02 * P.m22 + F.g03 * P.m23;
  const T fp03 = P.m03 * c.d + F.g02 * P.m23 + F.g03 * P.m33;
  const T fp11 = P.m11 * c.d + F.g12 * P.m12 + F.g13 * P.m13;
  const T fp12 = P.m12 * c.d + F.g12 * P.m22 + F.g13 * P.m23;
  const T fp13 = P.m13 * c.d + F.g12 * P.m23 + F.g13 * P.m33;
  const T fp32 = P.m23 + P.m22 * c.T_s;
  const T fp33 = P.m33 + P.m23 * c.T_s;
  return {fp00 * c.d + fp02 * F.g02 + fp03 * F.g03 + Q[0],  // (F P) F' + Q
          fp01 * c.d + fp02 * F.g12 + fp03 * F.g13,
          fp02,
          fp03 + fp02 * c.T_s,
          fp11 * c.d + fp12 * F.g12 + fp13 * F.g13 + Q[1],
          fp12,
          fp13 + fp12 * c.T_s,
          P.m22 + Q[2],
          fp32,
          fp33 + fp32 * c.T_s + Q[3]};
}

template <class T, class S>
Gain42<T> gain(const Symmetric4<T>& P_prior, const S (&R)[2]) {
  const Symmetric4<T>& p = P_prior;
  const T s00 = p.m00 + R[0], s11 = p.m11 + R[1];
  const T inv_det = S(1) / (s00 * s11 - p.m01 * p.m01);
  const T v00 = s11 * inv_det, v01 = -(p.m01 * inv_det), v11 = s00 * inv_det;  // S^-1
  return {p.m00 * v00 + p.m01 * v01, p.m00 * v01 + p.m01 * v11, p.m01 * v00 + p.m11 * v01,
          p.m01 * v01 + p.m11 * v11, p.m02 * v00 + p.m12 * v01, p.m02 * v01 + p.m12 * v11,
          p.m03 * v00 + p.m13 * v01, p.m03 * v01 + p.m13 * v11};
}

// "paper": (I - K H) P^-, by P H' = K R.
template <class T, class S>
Symmetric4<T> posterior(const Symmetric4<T>& P_prior, const Gain42<T>& K, const S (&R)[2]) {
  const Symmetric4<T>& p = P_prior;
  return {K.k00 * R[0],
          K.k10 * R[0],
          K.k20 * R[0],
          K.k30 * R[0],
          K.k11 * R[1],
          K.k21 * R[1],
          K.k31 * R[1],
          p.m22 - (K.k20 * p.m02 + K.k21 * p.m12),
          p.m23 - (K.k20 * p.m03 + K.k21 * p.m13),
          p.m33 - (K.k30 * p.m03 + K.k31 * p.m13)};
}

// "joseph": P = (I - K H) P^- (I - K H)' + K R K'. With M = (I - K H) P^-:
//
//   P_ij = M_ij - (M_i0 - K_i0 R_0) K_j0 - (M_i1 - K_i1 R_1) K_j1
//
// The brackets hold the rounding error of M.
template <class T, class S>
Symmetric4<T> posterior_joseph(const Symmetric4<T>& P_prior, const Gain42<T>& K, const S (&R)[2]) {
  const Symmetric4<T>& p = P_prior;
  const T n00 = S(1) - K.k00, n11 = S(1) - K.k11;
  const T m00 = n00 * p.m00 - K.k01 * p.m01, m01 = n00 * p.m01 - K.k01 * p.m11;
  const T m10 = n11 * p.m01 - K.k10 * p.m00, m11 = n11 * p.m11 - K.k10 * p.m01;
  const T m20 = p.m02 - (K.k20 * p.m00 + K.k21 * p.m01);
  const T m21 = p.m12 - (K.k20 * p.m01 + K.k21 * p.m11);
  const T m30 = p.m03 - (K.k30 * p.m00 + K.k31 * p.m01);
  const T m31 = p.m13 - (K.k30 * p.m01 + K.k31 * p.m11);
  const T m22 = p.m22 - (K.k20 * p.m02 + K.k21 * p.m12);
  const T m23 = p.m23 - (K.k20 * p.m03 + K.k21 * p.m13);
  const T m33 = p.m33 - (K.k30 * p.m03 + K.k31 * p.m13);
  const T b20 = m20 - K.k20 * R[0], b21 = m21 - K.k21 * R[1];
  const T b30 = m30 - K.k30 * R[0], b31 = m31 - K.k31 * R[1];
  return {n00 * m00 - m01 * K.k01 + K.k00 * K.k00 * R[0] + K.k01 * K.k01 * R[1],
          n11 * m01 - m00 * K.k10 + K.k00 * K.k10 * R[0] + K.k01 * K.k11 * R[1],
          n00 * m20 - m21 * K.k01 + K.k20 * K.k00 * R[0] + K.k21 * K.k01 * R[1],
          n00 * m30 - m31 * K.k01 + K.k30 * K.k00 * R[0] + K.k31 * K.k01 * R[1],
          n11 * m11 - m10 * K.k10 + K.k10 * K.k10 * R[0] + K.k11 * K.k11 * R[1],
          n11 * m21 - m20 * K.k10 + K.k20 * K.k10 * R[0] + K.k21 * K.k11 * R[1],
          n11 * m31 - m30 * K.k10 + K.k30 * K.k10 * R[0] + K.k31 * K.k11 * R[1],
          m22 - (b20 * K.k20 + b21 * K.k21),
          m23 - (b20 * K.k30 + b21 * K.k31),
          m33 - (b30 * K.k30 + b31 * K.k31)};
}

template <class T>
struct GainAndCovariance {
  Gain42<T> K;
  Symmetric4<T> P;
};

// "sequential": one output after the other, each a division by a number instead of an inverse of S.
// No determinant is formed, so nothing cancels if R is small compared with P^-. R must be diagonal.
//
//   k_j   = P e_j/(P_jj + R_j)         for j = 0, 1
//   P    <- P - k_j (P e_j)'           row j by P e_j = k_j R_j
//   K e_0 = (I - k_1 e_1') k_0
//   K e_1 = k_1
template <class T, class S>
GainAndCovariance<T> sequential(const Symmetric4<T>& P_prior, const S (&R)[2]) {
  const Symmetric4<T>& p = P_prior;
  const T inv_s0 = S(1) / (p.m00 + R[0]);
  const T a0 = p.m00 * inv_s0, a1 = p.m01 * inv_s0, a2 = p.m02 * inv_s0, a3 = p.m03 * inv_s0;
  const T q11 = p.m11 - a1 * p.m01, q12 = p.m12 - a1 * p.m02, q13 = p.m13 - a1 * p.m03;
  const T q22 = p.m22 - a2 * p.m02, q23 = p.m23 - a2 * p.m03, q33 = p.m33 - a3 * p.m03;
  const T q01 = a1 * R[0], inv_s1 = S(1) / (q11 + R[1]);
  const T b0 = q01 * inv_s1, b1 = q11 * inv_s1, b2 = q12 * inv_s1, b3 = q13 * inv_s1;
  const T one_b1 = R[1] * inv_s1;  // 1 - b1
  const Gain42<T> K{a0 - b0 * a1, b0, a1 * one_b1, b1, a2 - b2 * a1, b2, a3 - b3 * a1, b3};
  return {K,
          {K.k00 * R[0], K.k10 * R[0], K.k20 * R[0], K.k30 * R[0], b1 * R[1], b2 * R[1], b3 * R[1],
           q22 - b2 * q12, q23 - b2 * q13, q33 - b3 * q13}};
}

}  // namespace twinrate::kernel
