// The same filter with general matrix procedures, without use of its zeros: triple loops with a
// 64-bit sum for each element, transposes, H, I and Q as full matrices. For the comparison of Dilys
// 2021, Table 2; equal to ekf.hpp up to rounding.
//
//   F, H Q28   P, Q, R Q20   K, I Q25   S^-1 Q27   x, y, u Q25
#pragma once
#include "firmware/cortex_m3/ekf.hpp"

namespace twinrate::m3::matrix {

inline constexpr int kOneF = 1 << 28, kOneK = 1 << 25;

// c = a b / 2^kShift
template <class N, int kShift>
void multiply(const typename N::Word* a, const typename N::Word* b, typename N::Word* c, int rows,
              int inner, int columns) {
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) {
      typename N::Wide sum = N::wide(typename N::Word(0));
      for (int l = 0; l < inner; ++l) sum = sum + N::product(a[i * inner + l], b[l * columns + j]);
      c[i * columns + j] = N::template narrow<kShift>(sum);
    }
}

template <class N>
void transpose(const typename N::Word* a, typename N::Word* c, int rows, int columns) {
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < columns; ++j) c[j * rows + i] = a[i * columns + j];
}

template <class N>
void add(const typename N::Word* a, const typename N::Word* b, typename N::Word* c, int count) {
  for (int i = 0; i < count; ++i) c[i] = a[i] + b[i];
}
template <class N>
void subtract(const typename N::Word* a, const typename N::Word* b, typename N::Word* c,
              int count) {
  for (int i = 0; i < count; ++i) c[i] = a[i] - b[i];
}

template <class N>
struct Filter {
  using Word = typename N::Word;
  Word F[16], B[8], H[8], I[16], Q[16], R[4];
  Word P[16], P_prior[16], K[8];
  Word x[4], x_prior[4], u[2], y[2];  // x: i_alpha, i_beta, omega_e', theta_e' (modulo 2^32)
  UnitVector<N> at;
  StepConstants step;
  int32_t F_T, F_d, b_speed, b_angle;  // Q28, Q28; as in CovarianceConstants
};

template <class N>
void start(Filter<N>& f, const StepConstants& step, const CovarianceConstants& c) {
  using Word = typename N::Word;
  const Word zero(0);
  for (int i = 0; i < 16; ++i) f.F[i] = f.I[i] = f.Q[i] = f.P[i] = f.P_prior[i] = zero;
  for (int i = 0; i < 8; ++i) f.B[i] = f.H[i] = f.K[i] = zero;
  for (int i = 0; i < 4; ++i) {
    f.x[i] = f.x_prior[i] = f.R[i] = zero;
    f.I[5 * i] = Word(kOneK);
    f.Q[5 * i] = Word(c.Q[i]);
    f.P[5 * i] = Word(c.P0[i]);
  }
  f.R[0] = Word(c.R_P[0]);
  f.R[3] = Word(c.R_P[1]);
  f.H[0] = f.H[5] = Word(kOneF);
  f.step = step;
  f.F_T = c.T >> 4;
  f.F_d = kOneF + (c.minus_z >> 4);
  f.b_speed = c.b_speed;
  f.b_angle = c.b_angle;
}

// (11), (8)
template <class N>
void jacobian(Filter<N>& f) {
  using Word = typename N::Word;
  const Word zero(0), one(kOneF), b = Word(f.b_speed);
  const Word w = N::template narrow<29>(N::product(f.x[2], Word(f.b_angle)));
  for (int i = 0; i < 16; ++i) f.F[i] = zero;
  for (int i = 0; i < 8; ++i) f.B[i] = zero;
  f.F[0] = f.F[5] = Word(f.F_d);
  f.F[10] = f.F[15] = one;
  f.F[14] = Word(f.F_T);
  f.F[2] = N::template narrow<35>(N::product(f.at.sin, b));
  f.F[6] = -N::template narrow<35>(N::product(f.at.cos, b));
  f.F[3] = N::template narrow<35>(N::product(f.at.cos, w));
  f.F[7] = N::template narrow<35>(N::product(f.at.sin, w));
  f.B[0] = f.B[3] = Word(f.step.g) >> 4;
}

// (14)
template <class N>
void propagate(Filter<N>& f) {
  typename N::Word FP[16], Ft[16], FPFt[16];
  multiply<N, 28>(f.F, f.P, FP, 4, 4, 4);
  transpose<N>(f.F, Ft, 4, 4);
  multiply<N, 28>(FP, Ft, FPFt, 4, 4, 4);
  add<N>(FPFt, f.Q, f.P_prior, 16);
}

// (17)
template <class N>
void gain(Filter<N>& f) {
  typename N::Word Ht[8], PHt[8], HPHt[4], S[4];
  transpose<N>(f.H, Ht, 2, 4);
  multiply<N, 28>(f.P_prior, Ht, PHt, 4, 4, 2);
  multiply<N, 28>(f.H, PHt, HPHt, 2, 4, 2);
  add<N>(HPHt, f.R, S, 4);
  const Inverse2<N> v = inverse<N, 20>(S[0], S[1], S[3]);
  const typename N::Word V[4] = {v.v00, v.v01, v.v01, v.v11};
  multiply<N, 22>(PHt, V, f.K, 4, 2, 2);
}

// (15)
template <class N>
void posterior(Filter<N>& f, const CovarianceConstants& c, Clamps& clamps) {
  using Word = typename N::Word;
  Word KH[16], I_KH[16];
  multiply<N, 28>(f.K, f.H, KH, 4, 2, 4);
  subtract<N>(f.I, KH, I_KH, 16);
  multiply<N, 25>(I_KH, f.P_prior, f.P, 4, 4, 4);
  f.P[10] = clamped(f.P[10], Word(c.P22_max), clamps.P33);
  f.P[11] = f.P[14] = clamped(f.P[11], Word(c.P23_max), clamps.P34);
  f.P[15] = clamped(f.P[15], Word(c.P33_max), clamps.P44);
}

// (13): x^- = x + T f(x) + B u
template <class N>
void predict(Filter<N>& f) {
  using Word = typename N::Word;
  Word Tf[4], Bu[4], sum[4];
  const Word emf = N::template narrow<31>(N::product(f.x[2], Word(f.step.b)));
  const Word z = Word(f.step.minus_z);
  Tf[0] = N::template narrow<32>(N::product(z, f.x[0]) + N::product(emf, f.at.sin));
  Tf[1] = N::template narrow<32>(N::product(z, f.x[1]) - N::product(emf, f.at.cos));
  Tf[2] = Word(0);
  Tf[3] = N::template narrow<32>(N::product(f.x[2], Word(f.step.T)));
  multiply<N, 28>(f.B, f.u, Bu, 4, 2, 1);
  add<N>(Tf, Bu, sum, 4);
  add<N>(f.x, sum, f.x_prior, 3);
  const uint32_t theta = static_cast<uint32_t>(N::raw(f.x[3]));
  f.x_prior[3] = Word(static_cast<int32_t>(theta + static_cast<uint32_t>(N::raw(sum[3]))));
}

// (16)
template <class N>
void correct(Filter<N>& f) {
  using Word = typename N::Word;
  Word Hx[2], innov[2], change[4];
  multiply<N, 28>(f.H, f.x_prior, Hx, 2, 4, 1);
  subtract<N>(f.y, Hx, innov, 2);
  multiply<N, 25>(f.K, innov, change, 4, 2, 1);
  add<N>(f.x_prior, change, f.x, 3);
  const uint32_t theta = static_cast<uint32_t>(N::raw(f.x_prior[3]));
  f.x[3] = Word(static_cast<int32_t>(theta + static_cast<uint32_t>(N::raw(change[3]))));
}

}  // namespace twinrate::m3::matrix
