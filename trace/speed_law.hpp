// A load torque by another law of the speed than the catalogue's.
//
// The catalogue has torques in proportion to |omega_m|^0 (Coulomb), ^1 (viscous), ^2 (fan), and one
// that fades with the speed (Stribeck). One of them, or several together, may approximate another
// law over the speeds of a run: a fan, a Stribeck friction and a constant load of opposite signs
// followed |omega_m|^3 in one direction. So they are compared with one torque
//
//   T = c |omega_m|^p sgn(omega_m),  p from 1/4 to 5
//
// Without such a load its gain was below zero, or p within 0.06 of the catalogue's (38 claims in 400
// drawn logs); with |omega_m|^3 or |omega_m|^(1/2) it was 60 and more, and p within 0.02 (11 logs).
#pragma once
#include <cstddef>
#include <optional>
#include <vector>

#include "trace/fit.hpp"

namespace twinrate {

struct SpeedLaw {
  std::vector<std::size_t> members;  // of the fit, that the law explains better
  double exponent = 0;               // p
  double gain = 0;  // N ln of the ratio of the errors, less the price of the parameters
};

// The law with the largest gain. Empty if no law explains the torque better than the fit's members
// by the fitter's margin.
std::optional<SpeedLaw> speed_law(const Fitter& fitter, const Fit& fit);

}  // namespace twinrate
