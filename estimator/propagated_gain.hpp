// Policy `propagated`: the covariance is stepped through every tick, and gains are computed for N
// speeds, between which the fast loop interpolates while the speed changes.
//
//   P(s)       all steps since the last snapshot in rotor axes, at the mean speed of both snapshots
//   omega_low  = max(|omega| - span, kSlowest span)
//   omega_top  = |omega| + span
//   omega_i    = omega_low + (omega_top - omega_low) (i/(N - 1))^2,  i = 0 .. N-1
//   K_i        the gain after n more steps from P(s) at the speed omega_i
//   K(|omega|) linear between the K_i
//   K_use      = T(theta_e) K(|omega|) R(-theta_e)     theta_e and omega of tick k-1
//
// The other direction of rotation: a drive viewed from the other end has the same filter with beta,
// speeds and angles negative.
//
//   K(-omega)  = S K(omega) S_y,  S = diag(1, -1, .., -1, -1),  S_y = diag(1, -1)
//
// Requires a filter whose first states are (alpha, beta) pairs and that has a steady state.
#pragma once
#include "estimator/filter.hpp"

namespace twinrate {

// True if the filter can run the policy.
bool offers_propagated(const Filter& filter);

// One background run. `previous` holds P and its angle (k < 0: P_0), `omega_m_before` is the speed
// of its snapshot; `n` ticks to the next snapshot. P and K of the result are in the stationary
// frame at the snapshot, as those of the other policies are.
Gain propagated_background(const Filter& filter, const Gain& previous, double omega_m_before,
                           const Estimate& snapshot, int n, double span_omega_m);

// `gain` as the fast loop uses it, the rotor at this speed and angle.
void use_at_speed(int pairs, double omega_m, double theta_e, Gain& gain);

}  // namespace twinrate
