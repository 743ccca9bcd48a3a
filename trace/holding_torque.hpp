// What holds the rotor: quasi-static logs and maps of holding currents.
//
//   K_t i_q = LP_tau[ sum_N A_N sin(N theta_m + phase_N) + direction T_C ] + K_t offset
//
// LP_tau: first-order low-pass, so that a slow run and a map at rest can be compared. It is a
// filter of the logged current or a controller that is slow to take up the torque; a log in which
// the current moves the rotor tells which (trace/motion.hpp). All orders up to a largest one are
// fitted together; those that stand out of the orders around them stay. The offset belongs to each
// log; where no log goes both ways but the logs together do, it is one for all.
#pragma once
#include <span>
#include <string>
#include <vector>

#include "trace/hooks.hpp"
#include "trace/position_log.hpp"

namespace twinrate {

struct Harmonic {
  int order = 0;
  double amplitude = 0, phase = 0;  // Nm, rad: A sin(order theta_m + phase)
  double sigma_amplitude = 0, sigma_phase = 0;
  double over_floor = 0;  // amplitude over that of the orders around it
};

struct HoldingTorque {
  std::vector<Harmonic> cogging;          // largest first
  std::vector<Harmonic> friction_ripple;  // turns its sign with the direction
  double T_C = 0, sigma_T_C = 0;          // Nm
  bool both_directions = false;    // else T_C and an offset cannot be told apart: T_C stays 0
  double lag = 0, sigma_lag = 0;   // s; 0: none found
  double lag_share = 0;            // of the squared rest at lag 0 that goes with the lag
  double rest = 0, variation = 0;  // A, rms: what is left; what there was, offsets aside
  std::size_t rows = 0;            // averages that were fitted
};

// Largest order looked for: three times the native one, 24 n_p where the slots are not known; never
// more than the rows carry.
int largest_order(const MachineParameters& machine, std::size_t rows);

// Throws TraceStopped.
HoldingTorque trace_holding_torque(std::span<const PositionLog* const> logs,
                                   const MachineParameters& machine, const TraceHooks& hooks = {});

// Current that the model holds at every row of a log.
std::vector<double> holding_current(const PositionLog& log, const HoldingTorque& torque,
                                    const MachineParameters& machine);

}  // namespace twinrate
