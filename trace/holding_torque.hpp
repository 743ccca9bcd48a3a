// The torque that holds the rotor, from quasi-static logs and maps of holding currents.
//
//   K_t i_q = LP_tau[ sum_N A_N sin(N theta_m + phase_N) + direction T_C ] + K_t offset
//
// LP_tau: first-order low-pass, which makes a slow run comparable with a map at rest. Its cause is
// either a filter of the logged current or a controller that takes up the torque slowly. A log in
// which the current moves the rotor distinguishes the two (trace/motion.hpp). All orders up to the
// largest one are fitted together. An order is kept if it exceeds the noise of the orders around
// it. Each log has its own offset. If no log has both directions but the logs together do, all logs
// share one offset.
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
  double over_floor = 0;  // amplitude over the noise of the orders around it
};

struct HoldingTorque {
  std::vector<Harmonic> cogging;          // largest first
  std::vector<Harmonic> friction_ripple;  // changes its sign with the direction
  double T_C = 0, sigma_T_C = 0;          // Nm
  bool both_directions = false;           // false: T_C and an offset are not separable, T_C is 0
  double lag = 0, sigma_lag = 0;          // s; 0: none found
  double lag_share = 0;                   // share of the squared residual that the lag removes
  double rest = 0, variation = 0;  // A, rms: of the residual; of the current less the offsets
  std::size_t rows = 0;            // fitted means
};

// Largest order of the search: three times the native one, 24 n_p if the number of slots is
// unknown, and at most what the number of rows supports.
int largest_order(const MachineParameters& machine, std::size_t rows);

// Throws TraceStopped.
HoldingTorque trace_holding_torque(std::span<const PositionLog* const> logs,
                                   const MachineParameters& machine, const TraceHooks& hooks = {});

// Current that the model needs to hold the rotor, at every row of a log.
std::vector<double> holding_current(const PositionLog& log, const HoldingTorque& torque,
                                    const MachineParameters& machine);

}  // namespace twinrate
