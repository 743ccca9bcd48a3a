// Data-sheet values -> machine parameters in the units of a drive file.
//
// Star connection, sinusoidal EMF. Electrical speed omega_e = n_p omega_m, psi_f the peak flux
// linkage of a phase:
//
//   phase EMF, peak        e   = psi_f omega_e
//   line to line, peak     sqrt(3) e                    rms values: divided by sqrt(2)
//   K_v, rpm/V             E   = 1 V at K_v rpm         K_e, V/krpm: E = K_e at 1000 rpm
//   torque                 T   = 3/2 n_p psi_f i_q      i_q peak; K_t(rms) = sqrt(2) K_t(peak)
//   block commutation      T   = sqrt(3) n_p psi_f I    I direct, through two phases; K_t K_v = 30/pi
//   the same copper loss   I   = sqrt(3)/2 i_q          2 R_s I^2 = 3/2 R_s i_q^2
//   R, L between lines     two phases in series: R_s = R_ll/2, L = L_ll/2
//
// Block commutation, current I in two phases at a time, with the loss of a sinusoidal current:
//
//   torque                 T   = K_t I = sqrt(3) n_p psi_f I     the power of the EMF between lines
//   loss                   2 R_s I^2 = 3/2 R_s i^2               i = 2/sqrt(3) I
//
// Mechanical time constant, which some sheets print: tau_m = J R_s/(3/2 n_p^2 psi_f^2). It depends
// on R_s, J and psi_f, so it reveals a resistance that is given line to line.
#pragma once
#include <string>
#include <vector>

#include "datasheet/sheet.hpp"
#include "model/frames.hpp"
#include "model/machine.hpp"

namespace twinrate {

inline constexpr double kRadPerRpm = kTwoPi / 60;

struct MachineOfSheet {
  MachineParameters machine;
  double v_dc = 0;                       // V
  int encoder_counts = 0;                // 0: no encoder
  std::vector<std::string> conversions;  // one line each
  std::vector<std::string> assumed;      // values that the sheet does not give
  std::vector<std::string> doubts;       // values of the sheet that contradict each other
};

// Throws BadInput if the sheet lacks a value or gives two that contradict each other.
MachineOfSheet machine_of_sheet(const Sheet& sheet);

}  // namespace twinrate
