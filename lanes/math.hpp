// sine and cosine, logarithm, rounding and noise for lanes: branch-free, the same operations in
// every lane (fused as in lanes/lanes.hpp), accurate to about one unit in the last place.
//
//   sincos   x - k pi/2 in three parts (Cody and Waite), fdlibm's polynomials; |x| < 1e6
//   log      m 2^e with m in [sqrt(1/2), sqrt 2), fdlibm's polynomial in s = f/(2 + f); 0 < x < inf
//   normal   the same deviate as model/random.hpp from the same seed, to about 1e-15: same counter
//            generator, Box-Muller with the logarithm and cosine of this file
//   round    to even, by adding and taking away 1.5 2^52; |x| < 2^51
#pragma once
#include "lanes/lanes.hpp"

namespace twinrate::lanes {

constexpr double kRoundingShift = 0x1.8p52;

template <class T>
T round_to_even(T x) {
  return (x + kRoundingShift) - kRoundingShift;
}
template <class T>
struct SinCos {
  T sin, cos;
};

template <class T>
SinCos<T> sincos(T x) {
  const T shifted = x * 0x1.45f306dc9c883p-1 + kRoundingShift;  // 2/pi
  const T k = shifted - kRoundingShift;
  const T r = x - k * 0x1.921fb544p0 - k * 0x1.0b4611a6p-34 - k * 0x1.3198a2e037073p-69;
  const T z = r * r;
  const T sin_r =
      r + r * z *
              (-0x1.5555555555549p-3 +
               z * (0x1.111111110f8a6p-7 +
                    z * (-0x1.a01a019c161d5p-13 +
                         z * (0x1.71de357b1fe7dp-19 +
                              z * (-0x1.ae5e68a2b9cebp-26 + z * 0x1.5d93a5acfd57cp-33)))));
  const T cos_r =
      T(1) -
      (z * 0.5 - z * z *
                     (0x1.555555555554cp-5 +
                      z * (-0x1.6c16c16c15177p-10 +
                           z * (0x1.a01a019cb159p-16 +
                                z * (-0x1.27e4f809c52adp-22 +
                                     z * (0x1.1ee9ebdb4b1c4p-29 + z * -0x1.8fae9be8838d4p-37))))));
  const auto quadrant = shifted.bits();
  const auto odd = (quadrant & 1) != 0;
  const T s = T::of(odd ? cos_r.v : sin_r.v), c = T::of(odd ? sin_r.v : cos_r.v);
  return {T::of_bits(s.bits() ^ ((quadrant & 2) << 62)),
          T::of_bits(c.bits() ^ (((quadrant + 1) & 2) << 62))};
}

template <class T>
T log(T x) {
  // The upper bits of the mantissa select m or m/2, so that the result is near 1.
  const auto bits = x.bits() + (0x3ff0000000000000u - 0x3fe6a09e667f3bcdu);
  const T e = T::of_bits((bits >> 52) | 0x4330000000000000u) - (0x1p52 + 1023);
  const T m = T::of_bits((bits & 0x000fffffffffffffu) + 0x3fe6a09e667f3bcdu);
  const T f = m - T(1), s = f / (f + T(2)), z = s * s, half_f2 = f * f * 0.5;
  const T R = z * (0x1.5555555555593p-1 +
                   z * (0x1.999999997fa04p-2 +
                        z * (0x1.2492494229359p-2 +
                             z * (0x1.c71c51d8e78afp-3 +
                                  z * (0x1.7466496cb03dep-3 +
                                       z * (0x1.39a09d078c69fp-3 + z * 0x1.2f112df3e5244p-3))))));
  return e * 0x1.62e42feep-1 - ((half_f2 - (s * (half_f2 + R) + e * 0x1.a39ef35793c76p-33)) - f);
}

// SplitMix64's finaliser, as model/random.hpp.
template <class Bits>
Bits splitmix64(Bits z) {
  z += 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

// The upper 52 bits of b as a number 1 + (b >> 12) 2^-52 in [1, 2).
template <class T>
T one_to_two(typename T::Bits b) {
  return T::of_bits((b >> 12) | 0x3ff0000000000000u);
}

// u = ((b >> 11) + 1) 2^-53 without a conversion: the upper 52 bits, then the last bit plus the
// one.
template <class T>
T uniform_of(typename T::Bits b) {
  const T upper = one_to_two<T>(b) - (1 + 0x1p-12);
  const T last = T::of_bits((b & 0x800u) + 0x3f30000000000800u);  // 2^-12 + 2^-53 + that bit
  return upper + last;
}

// cos(2 pi u) = sin(2 pi w), w = |u - 1/2| - 1/4, up to the last bit.
template <class T>
T cos_of_turn(typename T::Bits b) {
  const T w = abs(one_to_two<T>(b) - 1.5) - T(0.25), z = w * w;
  return w * (6.283185307179586476 +
              z * (-41.34170224039975686 +
                   z * (81.60524927607361518 +
                        z * (-76.70585975282491921 +
                             z * (42.05869392542868225 +
                                  z * (-15.09464167611790009 +
                                       z * (3.819928094227164202 +
                                            z * (-0.7177337921413453313 +
                                                 z * 0.1008969550164681116))))))));
}

// Standard normal deviate of the streams whose hashed seeds are u1 and u2, at `index`.
template <class T>
T normal(T u1_hash, T u2_hash, typename T::Bits index) {
  const T u1 = uniform_of<T>(splitmix64(u1_hash.bits() ^ index));
  return sqrt<T>(log(u1) * -2.0) * cos_of_turn<T>(splitmix64(u2_hash.bits() ^ index));
}

// A whole number below 2^52 as an integer.
template <class T>
typename T::Bits integer_of(T x) {
  return (x + 0x1p52).bits() & 0x000fffffffffffffu;
}

constexpr double kTurn = 0x1.921fb54442d18p2;

// Into [-pi, pi].
template <class T>
T wrap_pi(T angle) {
  const T turns = (angle * (1 / kTurn) + kRoundingShift) - kRoundingShift;
  return angle - turns * kTurn;
}

}  // namespace twinrate::lanes
