// SAMPLE of the protocol -> raw numbers: Q25 of the phase currents and the voltage, then Clarke.
//
//   i_alpha = 2/3 i_a - 1/3 i_b - 1/3 i_c
//   i_beta  = (i_b - i_c)/sqrt3
//
// A reading beyond 63 A or V, or one that is not a number, counts as 63: a converter is limited,
// too.
#pragma once
#include "firmware/cortex_m3/two_rate.hpp"
#include "firmware/protocol/twinrate_protocol.h"

namespace twinrate::m3 {

// x in Q25, rounded down, computed from its bits, so that no library is needed.
inline int32_t raw_of(float x) {
  union {
    float x;
    uint32_t bits;
  } both;
  both.x = x;
  const int exponent = static_cast<int>(both.bits >> 23 & 255) - 127;
  const uint32_t mantissa = (both.bits & 0x7fffff) | 0x800000;  // 1.xxx in Q23
  const int up = exponent + kStateBits - 23;
  const uint32_t end = 63u << kStateBits;
  uint32_t size = exponent > 5 ? end : up >= 0 ? mantissa << up : up > -24 ? mantissa >> -up : 0;
  if (size > end) size = end;
  return both.bits >> 31 ? -static_cast<int32_t>(size) : static_cast<int32_t>(size);
}

template <class L>
Sample reading(const twp_sample& s) {
  using Word = typename L::Word;
  constexpr double kOne = 2147483648.0;
  const auto thirds = [](Word i, double share) {
    return L::product(i, Word(static_cast<int32_t>(share * kOne)));
  };
  const Word a = Word(raw_of(static_cast<float>(s.i_abc[0]))),
             b = Word(raw_of(static_cast<float>(s.i_abc[1]))),
             c = Word(raw_of(static_cast<float>(s.i_abc[2])));
  constexpr double kInverseSqrt3 = 0.57735026918962576;
  const Word i_alpha =
      L::template narrow<31>(thirds(a, 2.0 / 3) - thirds(b, 1.0 / 3) - thirds(c, 1.0 / 3));
  const Word i_beta = L::template narrow<31>(thirds(b, kInverseSqrt3) - thirds(c, kInverseSqrt3));
  return {L::raw(i_alpha), L::raw(i_beta), raw_of(static_cast<float>(s.u_alphabeta[0])),
          raw_of(static_cast<float>(s.u_alphabeta[1]))};
}

}  // namespace twinrate::m3
