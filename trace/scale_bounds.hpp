// What the scales of a log say: this machine, or another.
#pragma once
#include "trace/scale_factors.hpp"

namespace twinrate {

// Beyond these a scale is no effect of a working drive: magnets lose a fifth when hot, copper gains
// two thirds from cold to hot, iron saturates to a half, a load adds to the inertia. What a voltage
// bends with a small current passes for several times a small R_s. As factors, or their inverses.
struct ScaleBounds {
  double psi_f = 1.33, R_s = 30, L = 3;
  double lightest = 3, heaviest = 30;  // of K_t/J: times as much, or as little
};
inline constexpr ScaleBounds kThisMachine;

inline constexpr double kDegree = kTwoPi / 360;
// Of the voltage's power: a frame that explains less is another's, one that explains more is right.
inline constexpr double kFrameFails = 0.7, kFrameFits = 0.9;
// Of the torque's power, beside frictions and load: the current moves the rotor.
inline constexpr double kMoves = 0.5;
inline constexpr double kSlowTurn = 0.3;  // rad between rows: further on, samples are no means
// Electrical: a drive would lose a third of its torque.
inline constexpr double kFarZero = kTwoPi / 8;
inline constexpr double kScaleSigmas = 4;
inline constexpr double kSlowestRow_s = 0.02;  // rows of a moving drive stand closer

// What lies beyond what effects do.
struct Beyond {
  bool R_s, L, psi_f, K_t_J, T_load;
  bool any() const { return of_machine() || T_load; }
  bool of_machine() const { return R_s || L || psi_f || K_t_J; }
};
Beyond beyond(const ScaleFactors& f);

bool turned_by_half(const ScaleFactors& f);
// The log is one of this machine; `K_t_J`: that ratio over the declared, where it is to differ.
bool is_this_machine(const ScaleFactors& f, double K_t_J = 1);
// The declared magnet is where it should be: the rest of the voltage is the loop's own, a controller's
// answer to noise and to the steps of the angle.
bool magnet_in_place(const ScaleFactors& f);

}  // namespace twinrate
