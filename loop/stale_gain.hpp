// Two predictions of f_bmin, for comparison with the simulated drive. Both omit the controller.
//
//   formula   a gain stale by the angle phi acts on a rotated innovation and converges up to
//               phi_c = atan2(omega_e k4d - k3q, -(omega_e k4q + k3d))
//             with k3, k4 the speed and angle rows of K in rotor axes. Mean age of the gain beyond
//             that with n = 1: `paper` (3n - 3)/2 ticks, `immediate` (n - 1)/2 ticks. Hence
//               n_max = floor(1 + m phi_c/(omega_e T_s)),  m = 2/3 (`paper`), 2 (`immediate`)
//             The other policies have mean age zero: no limit.
//   Floquet   e_{k+1} = (I - K_k H) F_k e_k in rotor axes over one background period, K_k as the
//             policy uses it in steady state: stable if the spectral radius rho < 1. Uses every
//             stale angle of the period instead of the mean.
#pragma once
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "estimator/two_rate.hpp"

namespace twinrate {

struct Steady {
  std::shared_ptr<const Filter> filter;
  GainPolicy policy;
  double omega_m = 0, omega_e = 0, T_s = 0;
  double span_omega_m = 1;  // policy propagated: gain.speed_span_rad_s, mechanical
  // Operating point, theta_e = 0. Empty: the steady state of the filter without load.
  std::optional<Estimate> at = {};
  // Periodic gains by n that the functions below have computed for this steady state. Copies share
  // them: not for several threads.
  std::shared_ptr<std::map<int, Gain>> found = std::make_shared<std::map<int, Gain>>();
};

// The gains of one background period of n ticks in steady state, tick by tick, as the policy uses
// them, each in the axes of the rotor at the tick before. For the closed loop
// (loop/closed_floquet.hpp).
std::vector<Gain> rotor_gains_of_period(const Steady& steady, int n);

// phi_c with the steady-state gain of the policy's background, a snapshot every n ticks. NaN for
// filters other than `ekf_sensorless`.
double critical_angle(const Steady& steady, int n);
// Largest n that satisfies the formula, up to `limit`; 0: the formula gives no limit.
int n_max_by_formula(const Steady& steady, int limit);
// Spectral radius over one period of n ticks.
double spectral_radius(const Steady& steady, int n);
// Last n before the first with rho >= 1; at most `limit`.
int n_max_by_floquet(const Steady& steady, int limit);

}  // namespace twinrate
