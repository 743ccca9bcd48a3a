// Sine, cosine, exponential, logarithm and their relatives with the same bits on every x86-64.
//
// glibc selects its own by the processor: with FMA they round differently than without. A closed
// loop amplifies one such bit. These functions use only + - * / and sqrt, each one IEEE operation
// (-ffp-contract=off: no compiler joins two into one), so the result is a function of the argument
// alone. The error is below one unit in the last place for sincos, exp, log, atan and expm1, below
// two for log1p and atan2, below three for tanh and asin (tests/model/math_test.cpp).
//
//   sincos   r = x - k pi/2 in three parts and a remainder (Cody, Waite), polynomials in r;
//            |x| >= 1e6: x 2/pi with as many digits of 2/pi as count (Payne, Hanek)
//   exp      x = k ln 2 + r,   e^r = 1 + r + r c/(2 - c),   c(r) a polynomial
//   log      x = 2^k (1 + f),  log(1 + f) = f - f^2/2 + s (f^2/2 + R(s)),   s = f/(2 + f)
//   pow      exp(y log x) for x >= 0: the error grows with |y log x|
//
// NaN gives NaN; infinity gives the limit, sincos of it NaN.
//
// Source of methods and coefficients: fdlibm (netlib.org/fdlibm).
//   Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved. Developed at SunSoft, a Sun
//   Microsystems, Inc. business. Permission to use, copy, modify, and distribute this software is
//   freely granted, provided that this notice is preserved.
#pragma once
#include <bit>
#include <cmath>
#include <complex>
#include <cstdint>
#include <type_traits>

#include "model/four.hpp"
#include "model/pair.hpp"

namespace twinrate::math {

// T of the templates: double, or Four with the same bits in each lane. No function returns a Four
// or takes one by value: with AVX2 they travel in other registers than without.
template <class T>
using BitsOf = std::conditional_t<std::is_same_v<T, double>, std::uint64_t, FourBits>;

template <class T>
struct SinCosOf {
  T sin, cos;
};
using SinCos = SinCosOf<double>;

// x = (k + 4 i) pi/2 + r + tail for some whole i; |r| <= pi/4 but for the last digits.
template <class T>
struct QuarterTurnsOf {
  T r, tail;
  BitsOf<T> k;  // its two lowest bits count
};
using QuarterTurns = QuarterTurnsOf<double>;
QuarterTurns quarter_turns_far(double x);

// Inline in every caller: a separate instance could be compiled with other flags. |x| < 1e6
template <class T>
[[gnu::always_inline]] inline QuarterTurnsOf<T> quarter_turns_near(const T& x) {
  const T shifted = x * 0x1.45f306dc9c883p-1 + 0x1.8p52;  // 2/pi; rounds to a whole number
  const T k = shifted - 0x1.8p52;
  const T t = x - k * 0x1.921fb544p0;  // pi/2: exact, 33 bits times 20
  const T w = k * 0x1.0b4611a6p-34, a = t - w;
  const T v = k * 0x1.3198a2e037073p-69, r = a - v;
  return {r, ((t - a) - w) + ((a - r) - v), __builtin_bit_cast(BitsOf<T>, shifted)};
}
[[gnu::always_inline]] inline QuarterTurns quarter_turns(double x) {
  constexpr double kNear = 1e6;
  if (!(std::abs(x) < kNear)) [[unlikely]]
    return quarter_turns_far(x);
  return quarter_turns_near(x);
}

template <class T>
[[gnu::always_inline]] inline SinCosOf<T> sincos_of(const QuarterTurnsOf<T>& turns) {
  const T r = turns.r, tail = turns.tail;
  const T z = r * r, z2 = z * z, z_r = z * r, half = 0.5 * z;
  const T p = 0x1.111111110f8a6p-7 + z * (-0x1.a01a019c161d5p-13 + z * 0x1.71de357b1fe7dp-19) +
              z * z2 * (-0x1.ae5e68a2b9cebp-26 + z * 0x1.5d93a5acfd57cp-33);
  const T sin_r = r - ((z * (0.5 * tail - z_r * p) - tail) - z_r * -0x1.5555555555549p-3);
  const T q =
      z * (0x1.555555555554cp-5 + z * (-0x1.6c16c16c15177p-10 + z * 0x1.a01a019cb159p-16)) +
      z2 * z2 * (-0x1.27e4f809c52adp-22 + z * (0x1.1ee9ebdb4b1c4p-29 + z * -0x1.8fae9be8838d4p-37));
  const T one_less = 1.0 - half;
  const T cos_r = one_less + (((1.0 - one_less) - half) + (z * q - r * tail));
  const auto odd = (turns.k & 1) != 0;
  if constexpr (std::is_same_v<T, double>) {  // both in the register that holds their signs, too
    const Pair both = odd ? Pair{cos_r, sin_r} : Pair{sin_r, cos_r};
    const PairBits signs = {(turns.k & 2) << 62, ((turns.k + 1) & 2) << 62};
    const Pair result = __builtin_bit_cast(Pair, __builtin_bit_cast(PairBits, both) ^ signs);
    return {result[0], result[1]};
  }
  const T s = odd ? cos_r : sin_r, c = odd ? sin_r : cos_r;
  return {__builtin_bit_cast(T, __builtin_bit_cast(BitsOf<T>, s) ^ ((turns.k & 2) << 62)),
          __builtin_bit_cast(T, __builtin_bit_cast(BitsOf<T>, c) ^ (((turns.k + 1) & 2) << 62))};
}
[[gnu::always_inline]] inline SinCos sincos(double x) {
  return sincos_of(quarter_turns(x));
}

// x as 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt 2); x >= 2^-1022.
template <class T>
struct OctaveOf {
  T k, f;
};
template <class T>
[[gnu::always_inline]] inline OctaveOf<T> octave_of(const T& x) {
  constexpr std::uint64_t kSqrtHalf = 0x3fe6a09e667f3bcd, kOne = 0x3ff0000000000000;
  const BitsOf<T> bits = __builtin_bit_cast(BitsOf<T>, x) + (kOne - kSqrtHalf);
  const T k =
      __builtin_bit_cast(T, (bits >> 52) | std::bit_cast<std::uint64_t>(0x1p52)) - (0x1p52 + 1023);
  return {k, __builtin_bit_cast(T, (bits & 0x000fffffffffffff) + kSqrtHalf) - 1.0};
}

// log(2^k (1 + f) + rest), rest far below.
inline constexpr double kLn2 = 0x1.62e42feep-1,
                        kLn2Rest = 0x1.a39ef35793c76p-33;  // times 2^11: exact
template <class T>
[[gnu::always_inline]] inline void log_of(const OctaveOf<T>& x, double rest, T& log) {
  const T k = x.k, f = x.f;
  const T s = f / (2.0 + f), z = s * s, w = z * z, half_f2 = 0.5 * f * f;
  const T R =
      w * (0x1.999999997fa04p-2 + w * (0x1.c71c51d8e78afp-3 + w * 0x1.39a09d078c69fp-3)) +
      z * (0x1.5555555555593p-1 +
           w * (0x1.2492494229359p-2 + w * (0x1.7466496cb03dep-3 + w * 0x1.2f112df3e5244p-3)));
  log = k * kLn2 - ((half_f2 - (s * (half_f2 + R) + (k * kLn2Rest + rest))) - f);
}

// To the nearest whole number, halves away from zero, as std::round: without a call.
[[gnu::always_inline]] inline double round(double x) {
  constexpr double kWhole = 0x1p52;  // from here on every number is whole
  const double size = std::abs(x);
  if (!(size < kWhole)) return x;
  const double even = (size + kWhole) - kWhole;
  return std::copysign(size - even == 0.5 ? even + 1 : even, x);
}

double sin(double x);
double cos(double x);
double exp(double x);
double expm1(double x);
double log(double x);
double log1p(double x);
double pow(double x, double y);
double tanh(double x);
double atan(double x);
double atan2(double y, double x);
double asin(double x);

using Complex = std::complex<double>;
// r e^(j angle)
inline Complex polar(double r, double angle) {
  const SinCos at = sincos(angle);
  return {r * at.cos, r * at.sin};
}
inline Complex exp(const Complex& z) {
  return polar(exp(z.real()), z.imag());
}
inline double arg(const Complex& z) {
  return atan2(z.imag(), z.real());
}

}  // namespace twinrate::math
