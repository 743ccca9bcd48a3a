// Why a speed has the f_bmin it has: two predictions beside what the drive did.
//
//   formula   a gain stale by phi acts on a turned innovation; it stops converging at
//             phi_c = atan2(omega_e k4d - k3q, -(omega_e k4q + k3d)),  k: rows speed and angle of K
//             in rotor axes. Mean age beyond the ordinary filter's: `paper` (3n - 3)/2 ticks,
//             `immediate` (n - 1)/2; so n_max = floor(1 + m phi_c/(omega_e T_s)), m = 2/3 and 2.
//             For the other policies the mean age is zero: no limit from it.
//   Floquet   e_{k+1} = (I - K_k H) F_k e_k in rotor axes over one background period, K_k as the
//             policy uses it in steady state: stable while the spectral radius rho < 1. It takes
//             every stale angle within the hold, not their mean; neither knows the controller.
#pragma once
#include <memory>

#include "estimator/two_rate.hpp"

namespace twinrate::sweep {

struct Steady {
  std::shared_ptr<const Filter> filter;
  GainPolicy policy;
  double omega_m = 0, omega_e = 0, T_s = 0;
  double span_omega_m = 1;  // policy propagated: gain.speed_span_rad_s, mechanical
};

// NaN where the filter has no angle and speed in the third and fourth state (`ekf_sensorless` has).
// The gain is the one that the policy's background settles to with a snapshot every n ticks.
double critical_angle(const Steady& steady, int n);
// Last n that is not beyond its own limit, up to `limit`; 0: no limit from the formula.
int n_max_by_formula(const Steady& steady, int limit);
// Spectral radius over one period of n ticks.
double spectral_radius(const Steady& steady, int n);
// Last n before the first with rho >= 1, up to `limit` (then `limit` itself).
int n_max_by_floquet(const Steady& steady, int limit);

}  // namespace twinrate::sweep
