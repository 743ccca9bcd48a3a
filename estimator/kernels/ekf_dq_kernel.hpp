// The disturbance filter in rotor axes written out by hand: the equations of
// estimator/ekf_disturbance.hpp with their zeros, their symmetry and C = [I 0] used.
//
// Prediction (Euler):
//
//   x^-   = x + T_s f(x, u)                                                                    (24)
//   T_o^- = T_o + L T_s (omega_m - omega_m^-)                                                  (25)
//
// Correction:
//
//   x = x^- + K (y - [I 0] x^-)                                                                (23)
//
// Background:
//
//         [f00  f01  f02  0  ]
//   F   = [f10  f11  f12  0  ]
//         [f20  f21  1    f23]
//         [0    0    0    1  ]
//   P^- = F P F' + Q                                                                           (26)
//   K, P  one output after the other (R is diagonal): three divisions, no inverse        (27), (28)
//
// T: number or lanes (symmetric.hpp). S: the scalar of the constants.
// Source: Niewiara 2020, equation numbers.
#pragma once
#include "estimator/kernels/symmetric.hpp"

namespace twinrate::kernel {

// Every product of machine parameters and T_s that the step needs.
template <class S>
struct DqConstants {
  S T_s, L_T_s;          // L_T_s: L of (25) times T_s
  S d_d, d_q;            // 1 - T_s R_s/L_d, 1 - T_s R_s/L_q
  S cross_dq, cross_qd;  // T_s n_p L_q/L_d, T_s n_p L_d/L_q
  S emf;                 // T_s n_p psi_f/L_q
  S g_d, g_q;            // T_s/L_d, T_s/L_q
  S torque, reluctance;  // T_s/J 3/2 n_p psi_f, T_s/J 3/2 n_p (L_d - L_q)
  S g_T;                 // T_s/J
};

template <class S>
DqConstants<S> dq_constants(S R_s, S L_d, S L_q, S psi_f, S J, S n_p, S L, S T_s) {
  const S k_T = S(1.5) * n_p * T_s / J;
  return {T_s,
          L * T_s,
          1 - T_s * R_s / L_d,
          1 - T_s * R_s / L_q,
          T_s * n_p * L_q / L_d,
          T_s * n_p * L_d / L_q,
          T_s * n_p * psi_f / L_q,
          T_s / L_d,
          T_s / L_q,
          k_T * psi_f,
          k_T * (L_d - L_q),
          T_s / J};
}

template <class T>
struct DqState {
  T i_d, i_q, omega_m, T_o;
};
template <class T>
struct DqOutput {
  T i_d, i_q, omega_m;
};

// Euler, without the term of (25).
template <class T, class S>
DqState<T> predict_euler(const DqConstants<S>& c, const DqState<T>& x, const T& u_d, const T& u_q) {
  const T torque = x.i_d * c.reluctance + c.torque;  // a ampere of i_q, times T_s/J
  return {x.i_d * c.d_d + x.omega_m * c.cross_dq * x.i_q + u_d * c.g_d,
          x.i_q * c.d_q - x.omega_m * (x.i_d * c.cross_qd + c.emf) + u_q * c.g_q,
          x.omega_m + torque * x.i_q - x.T_o * c.g_T, x.T_o};
}

// (25) and (23); `y` measured, `x_predicted` from above. Returns the state, leaves the innovation.
template <class T, class S>
DqState<T> correct(const DqConstants<S>& c, const DqState<T>& x_predicted, const Gain43<T>& K,
                   const DqOutput<T>& y, DqOutput<T>& innov) {
  const DqState<T>& x = x_predicted;
  innov = {y.i_d - x.i_d, y.i_q - x.i_q, y.omega_m - x.omega_m};
  const auto row = [&](const T& x_i, const T& k0, const T& k1, const T& k2) {
    return x_i + k0 * innov.i_d + k1 * innov.i_q + k2 * innov.omega_m;
  };
  return {row(x.i_d, K.k00, K.k01, K.k02), row(x.i_q, K.k10, K.k11, K.k12),
          row(x.omega_m, K.k20, K.k21, K.k22),
          row(x.T_o + innov.omega_m * c.L_T_s, K.k30, K.k31, K.k32)};
}

template <class T, class S>
[[gnu::always_inline]] inline Symmetric4<T> propagate(const DqConstants<S>& c, const DqState<T>& x,
                                                      const Symmetric4<T>& P, const S (&Q)[4]) {
  const T f01 = x.omega_m * c.cross_dq, f02 = x.i_q * c.cross_dq;
  const T f10 = -(x.omega_m * c.cross_qd), f12 = -(x.i_d * c.cross_qd + c.emf);
  const T f20 = x.i_q * c.reluctance, f21 = x.i_d * c.reluctance + c.torque;
  // Row by row: (F P), then its entries of (F P) F' + Q. Few numbers are in use at a time.
  Symmetric4<T> out;
  const T fp00 = P.m00 * c.d_d + f01 * P.m01 + f02 * P.m02;
  const T fp01 = P.m01 * c.d_d + f01 * P.m11 + f02 * P.m12;
  const T fp02 = P.m02 * c.d_d + f01 * P.m12 + f02 * P.m22;
  out.m03 = P.m03 * c.d_d + f01 * P.m13 + f02 * P.m23;
  out.m00 = Q[0] + fp00 * c.d_d + fp01 * f01 + fp02 * f02;
  out.m01 = fp01 * c.d_q + fp00 * f10 + fp02 * f12;
  out.m02 = fp02 + fp00 * f20 + fp01 * f21 - out.m03 * c.g_T;

  const T fp10 = P.m01 * c.d_q + f10 * P.m00 + f12 * P.m02;
  const T fp11 = P.m11 * c.d_q + f10 * P.m01 + f12 * P.m12;
  const T fp12 = P.m12 * c.d_q + f10 * P.m02 + f12 * P.m22;
  out.m13 = P.m13 * c.d_q + f10 * P.m03 + f12 * P.m23;
  out.m11 = Q[1] + fp10 * f10 + fp11 * c.d_q + fp12 * f12;
  out.m12 = fp12 + fp10 * f20 + fp11 * f21 - out.m13 * c.g_T;

  const T fp20 = P.m02 + f20 * P.m00 + f21 * P.m01 - P.m03 * c.g_T;
  const T fp21 = P.m12 + f20 * P.m01 + f21 * P.m11 - P.m13 * c.g_T;
  const T fp22 = P.m22 + f20 * P.m02 + f21 * P.m12 - P.m23 * c.g_T;
  out.m23 = P.m23 + f20 * P.m03 + f21 * P.m13 - P.m33 * c.g_T;
  out.m22 = Q[2] + fp22 + fp20 * f20 + fp21 * f21 - out.m23 * c.g_T;
  out.m33 = P.m33 + Q[3];
  return out;
}

template <class T>
struct DqGainAndCovariance {
  Gain43<T> K;
  Symmetric4<T> P;
};

// One output after the other, for diagonal R:
//
//   k_j  = P e_j/(P_jj + R_j)          for j = 0, 1, 2
//   P   <- P - k_j (P e_j)'            for the states after j
//   K    = [(I - k_2 e_2') (I - k_1 e_1') k_0,  (I - k_2 e_2') k_1,  k_2]
//   P H' = K R
template <class T, class S>
[[gnu::always_inline]] inline DqGainAndCovariance<T> sequential(const Symmetric4<T>& P_prior,
                                                                const S (&R)[3]) {
  const Symmetric4<T>& p = P_prior;
  const T inv_s0 = S(1) / (p.m00 + R[0]);
  const T a0 = p.m00 * inv_s0, a1 = p.m01 * inv_s0, a2 = p.m02 * inv_s0, a3 = p.m03 * inv_s0;
  const T q11 = p.m11 - a1 * p.m01, q12 = p.m12 - a1 * p.m02, q13 = p.m13 - a1 * p.m03;
  const T q22 = p.m22 - a2 * p.m02, q23 = p.m23 - a2 * p.m03, q33 = p.m33 - a3 * p.m03;
  const T inv_s1 = S(1) / (q11 + R[1]), one_b1 = R[1] * inv_s1;  // 1 - b1
  const T b0 = a1 * R[0] * inv_s1, b1 = q11 * inv_s1, b2 = q12 * inv_s1, b3 = q13 * inv_s1;
  const T r22 = q22 - b2 * q12, r23 = q23 - b2 * q13, r33 = q33 - b3 * q13;
  const T e0 = a0 - b0 * a1, e1 = a1 * one_b1, e2 = a2 - b2 * a1, e3 = a3 - b3 * a1;
  const T inv_s2 = S(1) / (r22 + R[2]), one_c2 = R[2] * inv_s2;  // 1 - c2
  const T c0 = e2 * R[0] * inv_s2, c1 = b2 * R[1] * inv_s2, c2 = r22 * inv_s2, c3 = r23 * inv_s2;
  const Gain43<T> K{e0 - c0 * e2, b0 - c0 * b2, c0,  //
                    e1 - c1 * e2, b1 - c1 * b2, c1,  //
                    e2 * one_c2,  b2 * one_c2,  c2,  //
                    e3 - c3 * e2, b3 - c3 * b2, c3};
  return {K,
          {K.k00 * R[0], K.k10 * R[0], K.k20 * R[0], K.k30 * R[0], K.k11 * R[1], K.k21 * R[1],
           K.k31 * R[1], c2 * R[2], c3 * R[2], r33 - c3 * r23}};
}

}  // namespace twinrate::kernel
