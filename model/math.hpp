// Sine, cosine, exponential, logarithm and their relatives with the same bits on every x86-64.
//
// glibc selects its own by the processor: with FMA they round differently than without. A closed
// loop amplifies one such bit. These use + - * / and sqrt only, each one IEEE operation
// (-ffp-contract=off: no compiler joins two into one), so the result is a function of the argument
// and of nothing else. The error is below one unit in the last place for sincos, exp, log, atan and
// expm1, below two for log1p and atan2, below three for tanh and asin (tests/model/math_test.cpp).
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

namespace twinrate::math {

struct SinCos {
  double sin, cos;
};

// x = (k + 4 i) pi/2 + r + tail for some whole i; |r| <= pi/4 but for the last digits.
struct QuarterTurns {
  double r, tail;
  std::uint64_t k;  // its two lowest bits count
};
QuarterTurns quarter_turns_far(double x);

// Inline in every caller: an instance of its own could be one that other flags made.
[[gnu::always_inline]] inline QuarterTurns quarter_turns(double x) {
  constexpr double kNear = 1e6;
  if (!(std::abs(x) < kNear)) [[unlikely]]
    return quarter_turns_far(x);
  const double shifted = x * 0x1.45f306dc9c883p-1 + 0x1.8p52;  // 2/pi; rounds to a whole number
  const double k = shifted - 0x1.8p52;
  const double t = x - k * 0x1.921fb544p0;  // pi/2: exact, 33 bits times 20
  const double w = k * 0x1.0b4611a6p-34, a = t - w;
  const double v = k * 0x1.3198a2e037073p-69, r = a - v;
  return {r, ((t - a) - w) + ((a - r) - v), std::bit_cast<std::uint64_t>(shifted)};
}

[[gnu::always_inline]] inline SinCos sincos(double x) {
  const auto [r, tail, k] = quarter_turns(x);
  const double z = r * r, z2 = z * z, z_r = z * r, half = 0.5 * z;
  const double p = 0x1.111111110f8a6p-7 + z * (-0x1.a01a019c161d5p-13 + z * 0x1.71de357b1fe7dp-19) +
                   z * z2 * (-0x1.ae5e68a2b9cebp-26 + z * 0x1.5d93a5acfd57cp-33);
  const double sin_r = r - ((z * (0.5 * tail - z_r * p) - tail) - z_r * -0x1.5555555555549p-3);
  const double q =
      z * (0x1.555555555554cp-5 + z * (-0x1.6c16c16c15177p-10 + z * 0x1.a01a019cb159p-16)) +
      z2 * z2 * (-0x1.27e4f809c52adp-22 + z * (0x1.1ee9ebdb4b1c4p-29 + z * -0x1.8fae9be8838d4p-37));
  const double one_less = 1 - half;
  const double cos_r = one_less + (((1 - one_less) - half) + (z * q - r * tail));
  const bool odd = k & 1;
  const double s = odd ? cos_r : sin_r, c = odd ? sin_r : cos_r;
  return {std::bit_cast<double>(std::bit_cast<std::uint64_t>(s) ^ ((k & 2) << 62)),
          std::bit_cast<double>(std::bit_cast<std::uint64_t>(c) ^ (((k + 1) & 2) << 62))};
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
