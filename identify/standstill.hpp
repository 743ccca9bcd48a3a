// Experiments at standstill: wiring and pole pairs, resistance with the loss of the inverter,
// inductances.
//
//   pulses     growing voltage pulses along alpha until the current is large enough: L within a
//              factor of 2, for the current loop
//   wiring     a voltage vector turns two electrical turns forth and back; the encoder gives
//              n_p = turns of the vector/turns of the shaft, and the sign of the wiring
//   R_s        the rotor aligned with phase a, a current along it at fourteen levels, at four lower
//              ones for the form of the loss, and at the first level again:
//                u = R_s i + 2/3 V (sat(i/i_linear) + sat(i/(2 i_linear)))
//              V does not bias R_s: above i_linear the loss is constant
//   L_d, L_q   a sine of voltage on top of the aligning voltage, along d and along q, several
//              frequencies. Discrete transfer function with the exact hold; along q the rotor
//              gives way, which is part of the model:
//                L i' = u - R i - v        v' = c i - k w - d omega v        w' = v
//              v: EMF of the swing, c = 3/2 n_p^2 psi^2/J, k = omega_0^2 of the aligned rotor;
//              d omega: Coulomb friction, the same torque at every frequency omega of the sine
#pragma once
#include "identify/experiment.hpp"
#include "identify/found.hpp"

namespace twinrate {

// Fills n_p, mirrored, theta_zero, i_offset, R_s, loss, L_d, L_q, saturation_d. Leaves the rotor at
// rest and the hand set for the current loop. Throws RunFailed.
void identify_standstill(Experiment& e, Identified& found);

}  // namespace twinrate
