// Gains that turn with the rotor: policies `rotate` and `scheduled`.
//
//   rotate      x = x^- + diag(R(a), I) K R(-a) innov        a: angle turned since the snapshot
//   scheduled   the same with a table of the steady gain in rotor axes over |omega_e|, a = theta_e
//
// The table has 8 rows an octave from 1 to 4096 rad/s, and one at 0; K is linear between two rows.
// K(-omega) = diag(1, -1, -1, -1) K(omega) diag(1, -1): the mirror image on the d axis.
#pragma once
#include "firmware/cortex_m3/ekf.hpp"

namespace twinrate::m3 {

inline constexpr int kRowsAnOctaveLog2 = 3;
inline constexpr int kOctaves = 31 - kSpeedRawLog2;
inline constexpr int kScheduleRows = 2 + (kOctaves << kRowsAnOctaveLog2);

// The speed of a row, rad/s.
constexpr double schedule_speed(int row) {
  if (row == 0) return 0;
  const int step = row - 1, rows = 1 << kRowsAnOctaveLog2;
  return static_cast<double>(1 << (step >> kRowsAnOctaveLog2)) * (1 + (step % rows) / 8.0);
}

// K in rotor axes, format of Format32, in the order of Gain.
struct ScheduleTable {
  int32_t K[kScheduleRows][8];
};

template <class L>
TWINRATE_M3_INLINE Pair<L> turned(const UnitVector<L>& by, const Pair<L>& v) {
  return {L::template narrow<kUnitBits>(L::product(by.cos, v.alpha) - L::product(by.sin, v.beta)),
          L::template narrow<kUnitBits>(L::product(by.sin, v.alpha) + L::product(by.cos, v.beta))};
}
template <class L>
TWINRATE_M3_INLINE Pair<L> turned_back(const UnitVector<L>& by, const Pair<L>& v) {
  return turned<L>({-by.sin, by.cos}, v);
}

template <class N, class Q>
TWINRATE_M3_INLINE State<typename N::Long> correct_turned(
    const StepConstants& c, const State<typename N::Long>& prior, const Gain<N>& K,
    const UnitVector<typename N::Long>& by, const Pair<typename N::Long>& innov, Clamps& clamps) {
  using L = typename N::Long;
  const State<L> from_zero{{}, {}, prior.omega, prior.theta};
  State<L> x = correct<N, Q>(c, from_zero, K, turned_back<L>(by, innov), clamps);
  const Pair<L> change = turned<L>(by, {x.i_alpha, x.i_beta});
  x.i_alpha = prior.i_alpha + change.alpha;
  x.i_beta = prior.i_beta + change.beta;
  return x;
}

template <class L>
struct SchedulePlace {
  uint32_t row;
  typename L::Word share;  // of the next row, Q31
};
// `speed`: |omega_e| raw.
template <class L>
TWINRATE_M3_INLINE SchedulePlace<L> schedule_place(uint32_t speed) {
  using Word = typename L::Word;
  if (speed < 1u << kSpeedRawLog2)
    return {0, Word(static_cast<int32_t>(speed << (31 - kSpeedRawLog2)))};
  const uint32_t left = static_cast<uint32_t>(__builtin_clz(speed));
  const uint32_t mantissa = speed << left;  // 1.xxx, the leading one in bit 31
  const uint32_t octave = 31 - kSpeedRawLog2 - left;
  constexpr int kFraction = 31 - kRowsAnOctaveLog2;
  const uint32_t step = (mantissa & 0x7fffffff) >> kFraction;
  const uint32_t rest = (mantissa & ((1u << kFraction) - 1)) << kRowsAnOctaveLog2;
  return {1 + (octave << kRowsAnOctaveLog2) + step, Word(static_cast<int32_t>(rest))};
}

template <class L>
TWINRATE_M3_INLINE State<L> correct_scheduled(const StepConstants& c, const State<L>& prior,
                                              const ScheduleTable& table, typename L::Word omega,
                                              const UnitVector<L>& at, const Pair<L>& innov,
                                              Clamps& clamps) {
  using Word = typename L::Word;
  const bool backwards = omega < Word(0);
  const int32_t raw = L::raw(omega);
  const auto place = schedule_place<L>(static_cast<uint32_t>(backwards ? -raw : raw));
  const int32_t* low = table.K[place.row];
  const auto K = [&](int i) {
    const Word k = Word(low[i]);
    return k + L::template narrow<31>(L::product(place.share, Word(low[i + 8]) - k));
  };
  Pair<L> in = turned_back<L>(at, innov);
  if (backwards) in.beta = -in.beta;
  const auto row = [&](int i) {
    return L::product(K(i), in.alpha) + L::product(K(i + 1), in.beta);
  };
  constexpr int kK = Format32::kK;
  const Word i_d = L::template narrow<kK>(row(0));
  Word i_q = L::template narrow<kK>(row(2));
  auto speed = row(4), angle = row(6);
  if (backwards) {
    i_q = -i_q;
    speed = -speed;
    angle = -angle;
  }
  const Pair<L> change = turned<L>(at, {i_d, i_q});
  return {prior.i_alpha + change.alpha, prior.i_beta + change.beta,
          corrected_speed<L, kK>(c, prior.omega, speed, clamps),
          prior.theta + L::template modulo<kK>(angle)};
}

}  // namespace twinrate::m3
