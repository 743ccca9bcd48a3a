// The sensorless filter of estimator/kernels/ekf_sensorless_kernel.hpp in fixed point, written by
// hand: it uses the zeros, the symmetry and H = [I 0]. prediction = "euler", covariance = "paper".
//
//   i^-       = i - z i + T_s/L u +- b omega_e {sin, cos}                                      (13)
//   theta_e^- = theta_e + T_s omega_e                                                          (13)
//   x         = x^- + K (y - i^-)                                                              (16)
//
//               [0 0 g02 g03]
//   F   = I + [-z] [0 0 g12 g13]     b = T_s psi_f/L,  z = T_s R_s/L in rows 0, 1              (11)
//               [0 0 0   0  ]
//               [0 0 T'  0  ]
//   P^- = F P F' + Q                                                                           (14)
//   K   = P^- H' (P^-_(0..1)(0..1) + R)^-1                                                     (17)
//   P   = (I - K H) P^-,  by P H' = K R                                                        (15)
//
// Formats and their proofs: formats.hpp. N: number type, Q: format. Source: Dilys 2021.
#pragma once
#include "firmware/cortex_m3/sine.hpp"

namespace twinrate::m3 {

// Raw numbers, computed by constants.hpp. Plain integers, so that a link can carry them.
struct StepConstants {
  int32_t minus_z, g, T, b;  // Q32 of -T_s R_s/L, T_s/L, omega_e raw to theta_e raw; Q38 of b
  int32_t omega_max;         // raw
};
struct CovarianceConstants {
  int32_t minus_z, T;      // kF
  int32_t b_speed;         // Q32 of b 2^kSpeedLog2
  int32_t b_angle;         // Q(42 - kHead) of b 2 pi/2^kAngleLog2
  int32_t Q[4], P0[4];     // kP
  int32_t R_P[2], R_K[2];  // kP, kR
  int32_t P22_max, P33_max, P23_max;
};

struct Clamps {
  uint32_t P33 = 0, P34 = 0, P44 = 0, omega = 0;  // the paper's indices
};

template <class N>
struct State {
  typename N::Word i_alpha{}, i_beta{}, omega{};
  uint32_t theta = 0;
};
template <class N>
struct Pair {
  typename N::Word alpha, beta;
};

template <class N>
struct Covariance {
  typename N::Cell m00, m01, m02, m03, m11, m12, m13, m22, m23, m33;
};
template <class N>
struct Gain {
  typename N::Cell k00, k01, k10, k11, k20, k21, k30, k31;
};
template <class N>
struct Jacobian {
  typename N::Cell g02, g03, g12, g13;
};

// w / 2^kShift, rounded to nearest if the format asks for it.
template <class N, class Q, int kShift>
TWINRATE_M3_INLINE typename N::Word scaled(typename N::Wide w) {
  if constexpr (Q::kRounds) w = w + typename N::Wide(1 << (kShift - 1));
  return N::template narrow<kShift>(w);
}

template <class Word>
TWINRATE_M3_INLINE Word clamped(Word value, Word limit, uint32_t& count) {
  if (value > limit) {
    ++count;
    return limit;
  }
  if (value < -limit) {
    ++count;
    return -limit;
  }
  return value;
}

// The state has the Long type of N.
template <class L>
TWINRATE_M3_INLINE State<L> predict(const StepConstants& c, const State<L>& x,
                                    const UnitVector<L>& at, const Pair<L>& u) {
  using Word = typename L::Word;
  const Word minus_z = Word(c.minus_z), g = Word(c.g);
  const Word emf = L::template narrow<kSpeedRawLog2 + kEmfConstantBits - kEmfBits>(
      L::product(x.omega, Word(c.b)));
  const Word turned = L::template narrow<kStepBits>(L::product(x.omega, Word(c.T)));
  return {
      x.i_alpha + L::template narrow<kStepBits>(L::product(minus_z, x.i_alpha) +
                                                L::product(g, u.alpha) + L::product(emf, at.sin)),
      x.i_beta + L::template narrow<kStepBits>(L::product(minus_z, x.i_beta) +
                                               L::product(g, u.beta) - L::product(emf, at.cos)),
      x.omega, x.theta + static_cast<uint32_t>(L::raw(turned))};
}

// omega_e + change/2^kShift; the change may be of any size.
template <class L, int kShift>
TWINRATE_M3_INLINE typename L::Word corrected_speed(const StepConstants& c, typename L::Word omega,
                                                    typename L::Wide change, Clamps& clamps) {
  using Word = typename L::Word;
  constexpr int kDown = 32 - kShift;
  const Word limit = Word(c.omega_max);
  const Word coarse = (omega >> kDown) + L::template narrow<32>(change);
  const Word coarse_limit = limit >> kDown;
  if (coarse < coarse_limit && coarse > -coarse_limit)
    return omega + L::template narrow<kShift>(change);
  ++clamps.omega;
  return coarse > Word(0) ? limit : -limit;
}

template <class N, class Q>
TWINRATE_M3_INLINE State<typename N::Long> correct(const StepConstants& c,
                                                   const State<typename N::Long>& x,
                                                   const Gain<N>& K,
                                                   const Pair<typename N::Long>& innov,
                                                   Clamps& clamps) {
  using L = typename N::Long;
  using Word = typename L::Word;
  const auto row = [&](typename N::Cell k_alpha, typename N::Cell k_beta) {
    return L::product(Word(k_alpha), innov.alpha) + L::product(Word(k_beta), innov.beta);
  };
  constexpr int kSpeedShift = Q::kK + 6 - Q::kSpeedLog2;  // to units of 64 rad/s
  constexpr int kAngleShift = Q::kK - 7 + Q::kAngleLog2;  // to units of 1/128 turn
  return {x.i_alpha + L::template narrow<Q::kK>(row(K.k00, K.k01)),
          x.i_beta + L::template narrow<Q::kK>(row(K.k10, K.k11)),
          corrected_speed<L, kSpeedShift>(c, x.omega, row(K.k20, K.k21), clamps),
          x.theta + L::template modulo<kAngleShift>(row(K.k30, K.k31))};
}

template <class L>
TWINRATE_M3_INLINE Pair<L> innovation(const State<L>& x_prior, const Pair<L>& y) {
  return {y.alpha - x_prior.i_alpha, y.beta - x_prior.i_beta};
}

template <class N, class Q>
TWINRATE_M3_INLINE Jacobian<N> jacobian(const CovarianceConstants& c, typename N::Long::Word omega,
                                        const UnitVector<typename N::Long>& at) {
  using L = typename N::Long;
  using Word = typename L::Word;
  constexpr int kSpeedShift = kUnitBits + 32 - Q::kF;
  constexpr int kAngleShift = kUnitBits + 32 - Q::kHead - Q::kF;
  const Word b = Word(c.b_speed);
  const Word w = L::template narrow<kSpeedRawLog2 + 42 - 32>(L::product(omega, Word(c.b_angle)));
  const auto cell = [](Word value) { return N::cell(typename N::Word(value)); };
  return {cell(L::template narrow<kSpeedShift>(L::product(at.sin, b))),
          cell(L::template narrow<kAngleShift>(L::product(at.cos, w))),
          cell(-L::template narrow<kSpeedShift>(L::product(at.cos, b))),
          cell(L::template narrow<kAngleShift>(L::product(at.sin, w)))};
}

template <class N, class Q>
TWINRATE_M3_INLINE Covariance<N> propagate(const CovarianceConstants& c, const Jacobian<N>& F,
                                           const Covariance<N>& P) {
  using W = typename N::Word;
  const auto times = [](W a, W b) { return N::product(a, b); };
  const auto down = [](typename N::Wide w) { return scaled<N, Q, Q::kF>(w); };
  const W z = W(c.minus_z), T = W(c.T), g02 = W(F.g02), g03 = W(F.g03), g12 = W(F.g12),
          g13 = W(F.g13);
  const W m02 = W(P.m02), m03 = W(P.m03), m12 = W(P.m12), m13 = W(P.m13), m22 = W(P.m22),
          m23 = W(P.m23), m33 = W(P.m33);
  const W f02 = m02 + down(times(z, m02) + times(g02, m22) + times(g03, m23));  // F P
  const W f03 = m03 + down(times(z, m03) + times(g02, m23) + times(g03, m33));
  const W f12 = m12 + down(times(z, m12) + times(g12, m22) + times(g13, m23));
  const W f13 = m13 + down(times(z, m13) + times(g12, m23) + times(g13, m33));
  const W m00 = W(P.m00), m01 = W(P.m01), m11 = W(P.m11);
  const W f00 = m00 + down(times(z, m00) + times(g02, m02) + times(g03, m03));
  const W f01 = m01 + down(times(z, m01) + times(g02, m12) + times(g03, m13));
  const W f11 = m11 + down(times(z, m11) + times(g12, m12) + times(g13, m13));
  const W f32 = m23 + down(times(T, m22)), f33 = m33 + down(times(T, m23));
  return {N::cell(f00 + down(times(z, f00) + times(g02, f02) + times(g03, f03)) + W(c.Q[0])),
          N::cell(f01 + down(times(z, f01) + times(g12, f02) + times(g13, f03))),
          N::cell(f02),
          N::cell(f03 + down(times(T, f02))),
          N::cell(f11 + down(times(z, f11) + times(g12, f12) + times(g13, f13)) + W(c.Q[1])),
          N::cell(f12),
          N::cell(f13 + down(times(T, f12))),
          N::cell(m22 + W(c.Q[2])),
          N::cell(f32),
          N::cell(f33 + down(times(T, f32)) + W(c.Q[3]))};
}

// 2^60/d for d in [2^30, 2^31), accurate to 2^-27: a quotient of 16 bits and one Newton step.
template <class L>
TWINRATE_M3_INLINE typename L::Word reciprocal(typename L::Word d) {
  using Word = typename L::Word;
  const Word q = Word(0x7fffffff / L::raw(d >> 15));  // 2^46/d
  const Word error =
      L::template narrow<16>(L::wide(Word(1 << 23)) * L::wide(Word(1 << 23)) - L::product(d, q));
  return L::shifted_left(q, 14) + L::template narrow<16>(L::product(q, error));
}

template <class L>
struct Inverse2 {
  typename L::Word v00, v01, v11;
};

// The inverse of a symmetric 2 by 2 matrix with eigenvalues of at least 1: Q(kBits) to Q27.
template <class L, int kBits>
TWINRATE_M3_INLINE Inverse2<L> inverse(typename L::Word s00, typename L::Word s01,
                                       typename L::Word s11) {
  using Word = typename L::Word;
  const int up = __builtin_clz(static_cast<unsigned>(L::raw(s00) | L::raw(s11))) - 1;
  const Word a = L::shifted_left(s00, up), b = L::shifted_left(s01, up),
             d = L::shifted_left(s11, up);
  const Word det = L::template narrow<32>(L::product(a, d) - L::product(b, b));
  const int up_det = __builtin_clz(static_cast<unsigned>(L::raw(det))) - 1;
  const Word r = reciprocal<L>(L::shifted_left(det, up_det));
  const int down = 33 - kBits - up - up_det;  // see formats.hpp: eigenvalues >= 1 keep it >= 0
  const auto entry = [&](Word s) { return L::template narrow<32>(L::product(s, r)) >> down; };
  return {entry(d), -entry(b), entry(a)};
}

template <class N, class Q>
TWINRATE_M3_INLINE Gain<N> gain(const CovarianceConstants& c, const Covariance<N>& P) {
  using L = typename N::Long;
  using LW = typename L::Word;
  using W = typename N::Word;
  const auto S = inverse<L, Q::kP>(LW(P.m00) + LW(c.R_P[0]), LW(P.m01), LW(P.m11) + LW(c.R_P[1]));
  constexpr int kDown = 27 - Q::kV;
  const W v00 = W(S.v00 >> kDown), v01 = W(S.v01 >> kDown), v11 = W(S.v11 >> kDown);
  const auto cell = [](W p_0, W v_0, W p_1, W v_1) {
    return N::cell(
        scaled<N, Q, Q::kP + Q::kV - Q::kK>(N::product(p_0, v_0) + N::product(p_1, v_1)));
  };
  const W m00 = W(P.m00), m01 = W(P.m01), m11 = W(P.m11), m02 = W(P.m02), m12 = W(P.m12),
          m03 = W(P.m03), m13 = W(P.m13);
  return {cell(m00, v00, m01, v01), cell(m00, v01, m01, v11), cell(m01, v00, m11, v01),
          cell(m01, v01, m11, v11), cell(m02, v00, m12, v01), cell(m02, v01, m12, v11),
          cell(m03, v00, m13, v01), cell(m03, v01, m13, v11)};
}

template <class N, class Q>
TWINRATE_M3_INLINE Covariance<N> posterior(const CovarianceConstants& c, const Covariance<N>& P,
                                           const Gain<N>& K, Clamps& clamps) {
  using W = typename N::Word;
  const W R_0 = W(c.R_K[0]), R_1 = W(c.R_K[1]);
  const auto by_R = [](typename N::Cell k, W R) {
    return N::cell(scaled<N, Q, Q::kK + Q::kR - Q::kP>(N::product(W(k), R)));
  };
  const auto less = [](typename N::Cell p, typename N::Cell k_0, typename N::Cell p_0,
                       typename N::Cell k_1, typename N::Cell p_1) {
    return W(p) - scaled<N, Q, Q::kK>(N::product(W(k_0), W(p_0)) + N::product(W(k_1), W(p_1)));
  };
  const W P22 = less(P.m22, K.k20, P.m02, K.k21, P.m12);
  const W P23 = less(P.m23, K.k20, P.m03, K.k21, P.m13);
  const W P33 = less(P.m33, K.k30, P.m03, K.k31, P.m13);
  return {by_R(K.k00, R_0),
          by_R(K.k10, R_0),
          by_R(K.k20, R_0),
          by_R(K.k30, R_0),
          by_R(K.k11, R_1),
          by_R(K.k21, R_1),
          by_R(K.k31, R_1),
          N::cell(clamped(P22, W(c.P22_max), clamps.P33)),
          N::cell(clamped(P23, W(c.P23_max), clamps.P34)),
          N::cell(clamped(P33, W(c.P33_max), clamps.P44))};
}

}  // namespace twinrate::m3
