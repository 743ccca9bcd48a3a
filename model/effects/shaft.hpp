// Two masses and the shaft between them, for the effects torsion and backlash and for the plant.
//
//   delta = theta_m - theta_load                   twist
//   T_shaft = K delta + D delta'                    without a gap
//   T_shaft = max(0, K (delta - gap/2) + D delta')  beyond a gap's upper flank (mirrored at the
//                                                   lower one), 0 between them: flanks only push
//   (J - J_load) omega_m' = T_em - B omega_m - effects - T_shaft
//   J_load omega_load' = T_shaft - T_load           the external load acts behind the shaft
//
// T_load is the declared load plus undeclared loads behind the shaft (Effect::behind_shaft). All
// other effects act on the motor side.
//
// Seen from the machine's own equation J omega_m' = T_em - .. - T_load the effect is therefore
// T_load += T_shaft - T_load and J += -J_load. (Two-inertia model as in Nordin and Gutman 2002,
// "Controlling mechanical systems with backlash", Automatica 38.)
#pragma once
#include <algorithm>
#include <span>

#include "model/effects/effect.hpp"

namespace twinrate {

// The second mass against the first.
struct ShaftState {
  double delta = 0;       // rad
  double omega_load = 0;  // rad/s
};

inline double shaft_torque(const ShaftFacts& shaft, double delta, double delta_rate) {
  const double half = 0.5 * shaft.gap, D_rate = shaft.damping * delta_rate;
  if (half <= 0) return shaft.stiffness * delta + D_rate;
  if (delta > half) return std::max(0.0, shaft.stiffness * (delta - half) + D_rate);
  if (delta < -half) return std::min(0.0, shaft.stiffness * (delta + half) + D_rate);
  return 0;
}

// The load turns with the motor and the shaft holds T_load; in mid-gap without a load.
ShaftState shaft_at_rest(const ShaftFacts& shaft, double omega_m, double T_load);

// The load behind the shaft at each point: T_load and the effects that act there.
std::vector<double> load_behind_shaft(const Effects& effects,
                                      std::span<const OperatingPoint> record);

// Contribution of the shaft to the machine's equation along a record, from theta_m of its points
// and the load behind it: the load mass is simulated behind the measured angle, from rest against
// the motor. Exact for an acceleration of the motor and a load that are constant within a sample,
// except for the moment at which a gap closes or opens, which is interpolated. theta_m may be
// wrapped into a turn. A load that rattles through a wide gap (30 mrad, hardly damped) remembers
// every small error of an impact until it comes to rest on a flank.
//
// `T_load` gets the torque; the inertia is -J_load throughout. `sums` gets both, with T_load alone
// behind the shaft.
void along_shaft(const ShaftFacts& shaft, std::span<const OperatingPoint> record,
                 std::span<const double> behind, double T_s, double held, std::span<double> T_load);
void along_shaft(const ShaftFacts& shaft, std::span<const OperatingPoint> record, double T_s,
                 std::span<Contribution> sums);

}  // namespace twinrate
