// Resistance from i_q and u_q alone.
//
//   at rest     u_q = R i_q + offset + sum_N U_N sin(N theta_m + phase_N)
//   in motion   u_q = R i_q + K_e omega_m + L (i_q)' + offset
//               means over twenty sampling intervals, omega_m and i_q' from the differences over
//               the same time: a lag of the speed signal cannot look like a resistance
//
// Ripple of once an electrical turn (N = n_p) at rest is an offset of the inverter or of the
// current sensors: both are constant in stator axes.
#pragma once
#include <span>
#include <vector>

#include "trace/holding_torque.hpp"

namespace twinrate {

struct WindingVoltage {
  double R = 0, sigma_R = 0;              // Ohm, of all logs; sigma 0: none
  double R_at_rest = 0, R_in_motion = 0;  // 0: no such log
  double R_by_logged_speed = 0;           // with the driver's late speed instead; 0: no log
  double K_e = 0;                         // Vs/rad, mechanical; n_p psi_f
  std::vector<Harmonic> ripple;           // V, at rest, largest first
  double rest = 0, rest_declared = 0;     // V, rms, as traced and with R_s, psi_f declared
  std::size_t rows = 0;
};

WindingVoltage trace_winding_voltage(std::span<const PositionLog* const> at_rest,
                                     std::span<const PositionLog* const> in_motion,
                                     const MachineParameters& machine);

}  // namespace twinrate
