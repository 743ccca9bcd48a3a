// Limits on the scales of a log: this machine, or another.
#pragma once
#include "trace/scale_factors.hpp"

namespace twinrate {

// A scale beyond these bounds is no effect of a working drive: magnets lose a fifth when hot,
// copper gains two thirds from cold to hot, iron saturates to a half, a load adds to the inertia. A
// non-linear voltage at a small current can look like several times a small R_s. The bounds are
// factors, or their inverses.
struct ScaleBounds {
  double psi_f = 1.33, R_s = 30, L = 3;
  double lightest = 3, heaviest = 30;  // of K_t/J: at most this factor higher, or lower
};
inline constexpr ScaleBounds kThisMachine;

inline constexpr double kDegree = kTwoPi / 360;
// Share of the voltage's power: a frame that explains less is wrong, one that explains more is
// right.
inline constexpr double kFrameFails = 0.7, kFrameFits = 0.9;
// Share of the torque's power, beside frictions and load, above which the current moves the rotor.
inline constexpr double kMoves = 0.5;
inline constexpr double kSlowTurn = 0.3;  // rad between rows; above it samples are no means
// rad electrical, at which a drive would lose a third of its torque.
inline constexpr double kFarZero = kTwoPi / 8;
inline constexpr double kScaleSigmas = 4;
inline constexpr double kSlowestRow_s = 0.02;  // a moving drive has shorter rows

// The scales beyond the bounds of effects.
struct Beyond {
  bool R_s, L, psi_f, K_t_J, T_load;
  bool any() const { return of_machine() || T_load; }
  bool of_machine() const { return R_s || L || psi_f || K_t_J; }
};
Beyond beyond(const ScaleFactors& f);

bool turned_by_half(const ScaleFactors& f);
// True if the log is one of this machine; `K_t_J`: the expected ratio to the declared, if not 1.
bool is_this_machine(const ScaleFactors& f, double K_t_J = 1);
// True if the declared magnet explains the voltage. The residual then comes from the loop itself,
// as the controller's response to noise and to the steps of the angle.
bool magnet_in_place(const ScaleFactors& f);

}  // namespace twinrate
