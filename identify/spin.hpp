// Experiments on the turning motor, without load: flux linkage, L_q over its current, inertia and
// friction.
//
//   ramps    i_q = +-0.25 .. 1 of the test current, from one end of the speed range to the other
//   coasts   no current, from several speeds in both directions
//
// Flux, in stationary axes, from the voltage less its losses; R(a) turns by a:
//
//   integral (u - drop - R_s i) dt = psi_0 + d t + R(theta_e) ([psi_f, 0] + [0, psi_x] + [L_d i_d, L_q i_q])
//
// psi_0 and d (offset of a sensor) are free in each piece; psi_x is nonzero if the zero of the
// angle is wrong. L_d, R_s and the drop are those at standstill; L_q is free for each current of
// the ramps.
//
// Motion, from the encoder angle, integrated twice: a quantised angle is not differentiated.
//
//   theta = theta_0 + omega_0 t + 1/J iint T - B/J iint omega - T_C/J iint sign(omega) - T_0/J t^2/2
//   T     = 3/2 n_p (psi_d i_q - psi_q i_d)
#pragma once
#include "identify/experiment.hpp"
#include "identify/found.hpp"

namespace twinrate {

// Needs the results of identify_standstill(). Fills psi_f, L_q, saturation_q, J, B, T_coulomb,
// T_constant, theta_zero. Throws RunFailed.
void identify_spin(Experiment& e, Identified& found);

}  // namespace twinrate
