// The Q formats of the fixed-point filter, and the proof that no number leaves its format.
//
// A raw number r in Q(f) is r / 2^f. The units of the states are chosen so that their covariances
// are similar in size:
//
//   current   1 A
//   speed     2^kSpeedLog2 rad/s                        64 rad/s            (16-bit variant: 128)
//   angle     one turn / 2^kAngleLog2                   1/128 turn          (16-bit variant: 1/8)
//
//   quantity                      format    largest that fits     bound, and where it comes from
//   i_alpha, i_beta, innov, y, u  Q25       64 A, V               (a), checked by check_ranges()
//   omega_e                       Q25       4096 rad/s            clamp at omega_max
//   theta_e                       Q25       modulo 2^32 = a turn  meant to wrap, unsigned
//   emf = b omega_e               Q26       32 A                  b omega_max
//   sin, cos                      Q31       1                     amplitude 1 - 2^-20
//   -z, g02, g03, T' (F - I)      Q32       0.5                   check_ranges() at omega_max
//   P, P^-, F P, Q                Q20       2048                  (b)
//   S = P^- + R                   Q20       2048                  (b)
//   S^-1                          Q27       16                    S >= R >= 1 A^2: at most 1
//   K                             Q25       64                    (c)
//
// 16-bit variant of P, K and F - I: F - I Q13 (4), P Q11 (16), K Q13 (4), S^-1 Q14 (2); S, its inverse
// and the states keep 32 bits.
//
// (a) z = T_s R_s/L. For R_0 = R_1 the leading 2 by 2 block of K is symmetric with eigenvalues in
//     [0, 1], in every policy: K is computed from a covariance, turned, or interpolated between such
//     gains. In its axes each corrected current lies between its prediction and the measurement, so
//         |i| <= sqrt(|i^-|^2 + |y|^2),   |i^-| <= (1 - z) |i| + g |u| + b omega_max.
//     Its fixed point bounds |i^-|, and |innov| <= |y| + |i^-|.
// (b) P is a covariance, so |P_jk| <= sqrt(P_jj P_kk); P_00, P_11 <= R, P_22 and P_33 are clamped.
//     Each row of F P F' is bounded by the triangle inequality:
//         sqrt(P^-_00) <= (1 - z) sqrt(R) + g02 sqrt(P_22) + g03 sqrt(P_33).
// (c) S >= R, so |K_jk| <= sqrt(P^-_jj / R).
//     (b) and (c) hold up to rounding: each operation rounds down by less than one unit of its last
//     place. The clamp of P_22, P_33 with |P_23| keeps P positive where P_23^2 <= P_22 P_33.
//
// Clamped, and counted (Clamps): P_22, P_33, |P_23| (P33, P44, P34 of the paper) and omega_e. No other
// quantity is saturated. check_ranges() of constants.hpp evaluates (a), (b) and (c) for a machine.
#pragma once
#include "firmware/cortex_m3/number.hpp"

namespace twinrate::m3 {

// States and constants of the fast step, the same in both variants.
inline constexpr int kStateBits = 25;     // i, omega_e', theta_e'
inline constexpr int kSpeedRawLog2 = 19;  // omega_e raw = 2^19 per rad/s
inline constexpr int kEmfBits = 26;
inline constexpr int kUnitBits = 31;  // sin, cos
inline constexpr int kStepBits = 32;  // -z, T_s/L, T_s
inline constexpr int kEmfConstantBits = 38;

struct Format32 {
  static constexpr int kSpeedLog2 = 6, kAngleLog2 = 7;
  static constexpr int kF = 32;    // F - I
  static constexpr int kHead = 0;  // w_1 = b omega_e 2 pi/2^kAngleLog2 lies below 2^(kHead - 1)
  static constexpr int kP = 20;
  static constexpr int kK = 25;
  static constexpr int kV = 27;  // S^-1
  static constexpr int kR = 27;  // R, where K R makes P
  static constexpr bool kRounds = false;
};

struct Format16 {
  static constexpr int kSpeedLog2 = 7, kAngleLog2 = 3;
  static constexpr int kF = 13;
  static constexpr int kHead = 4;
  static constexpr int kP = 11;
  static constexpr int kK = 13;
  static constexpr int kV = 14;
  static constexpr int kR = 12;
  static constexpr bool kRounds = true;
};

}  // namespace twinrate::m3
