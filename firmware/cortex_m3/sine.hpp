// Sine and cosine of an angle modulo 2^32, one turn:
//
//   sin(a + e) = sin a + e cos a - e^2/2 sin a       a in the middle of one of 256 sectors
//
// |e| <= pi/256, so the neglected e^3/6 is at most 3.1e-7. The amplitude is 1 - 2^-20, so that no
// result reaches 1 in Q31. Largest error 1.4e-6 (8e-5 deg).
#pragma once
#include "firmware/cortex_m3/formats.hpp"

namespace twinrate::m3 {

inline constexpr double kPi = 3.14159265358979323846;

// For tables that the compiler computes.
constexpr double sine_series(double angle) {
  double term = angle, sum = angle;
  for (int i = 1; i < 20; ++i) {
    term *= -angle * angle / (2 * i * (2 * i + 1));
    sum += term;
  }
  return sum;
}

inline constexpr int kSectors = 256, kQuarter = kSectors / 4;

struct SineTable {
  int32_t at[kSectors + kQuarter];  // Q31, the middle of each sector; a quarter turn more for cos
};
constexpr SineTable make_sine_table() {
  SineTable table{};
  for (int i = 0; i < kSectors + kQuarter; ++i) {
    double turns = (i + 0.5) / kSectors;
    if (turns > 0.5) turns -= 1;
    if (turns > 0.5) turns -= 1;
    const double scaled = sine_series(2 * kPi * turns) * (2147483648.0 - 2048.0);
    table.at[i] = static_cast<int32_t>(scaled + (scaled < 0 ? -0.5 : 0.5));
  }
  return table;
}
inline constexpr SineTable kSine = make_sine_table();

template <class N>
struct UnitVector {
  typename N::Word sin, cos;  // Q31
};

template <class N>
TWINRATE_M3_INLINE UnitVector<N> unit_vector(uint32_t theta) {
  using Word = typename N::Word;
  constexpr int32_t kTwoPi28 = static_cast<int32_t>(2 * kPi * (1 << 28));
  const uint32_t sector = theta >> 24;
  const Word s = Word(kSine.at[sector]), c = Word(kSine.at[sector + kQuarter]);
  const Word offset = Word(static_cast<int32_t>((theta & 0xffffff) << 7) - (1 << 30));
  const Word e = N::template narrow<32>(N::product(offset, Word(kTwoPi28)));  // Q35
  const Word half = N::template narrow<32>(N::product(e, e));                 // e^2/2, Q39
  // The small terms first: s + c e alone can exceed 1.
  return {s + ((N::template narrow<32>(N::product(c, e)) >> 3) -
               (N::template narrow<32>(N::product(s, half)) >> 7)),
          c - ((N::template narrow<32>(N::product(s, e)) >> 3) +
               (N::template narrow<32>(N::product(c, half)) >> 7))};
}

}  // namespace twinrate::m3
