// Scales of a log against its drive file, before any effect: least squares of the raw equations
// over short cells of rows, in rotor axes.
//
//   voltage  u_dq = s (r_R R_s i_dq + r_L (L i_dq' + J omega_e L i_dq) + omega_e psi + c sat(i_abc))
//   torque   J omega_m' + B omega_m = r_K K_t i_q - r_T T_load - T_C sign(omega_m) - b omega_m - T_0
//
// s = sin(x) / x with x half the electrical turn between rows: the factor that the mean in stator
// axes applies to a vector that turns with the rotor; 1 for the voltage of a tick. psi has both
// axes, because another zero of the angle does not change |psi|. sat(i) is the shape of a dead
// time. It, the frictions and T_0 are fitted so that they do not look like a scale. omega_m' is a
// second difference over a cell, under the same triangle as i_q. Standard deviations come from
// blocks of the log, so they include structure in time.
#pragma once
#include <Eigen/Core>
#include <cmath>
#include <limits>

#include "model/drive_facts.hpp"
#include "trace/record.hpp"

namespace twinrate {

// A value from the log over the declared one.
struct ScaleRatio {
  double value = 0, sigma = std::numeric_limits<double>::infinity();
  // Power that this value explains and the declared one does not, over the residual power of the
  // whole fit: below 1 the deviation is less than the error of the equation.
  double over_rest = 0;
  // True within 20 %, if the equation has the term.
  bool known() const { return std::isfinite(value) && value != 0 && log_sigma() < 0.2; }
  double log() const { return std::log(std::abs(value)); }
  double log_sigma() const { return sigma / std::abs(value); }
};

// Power of one equation's cells, as a function of its scales.
struct CellPower {
  using Scales = Eigen::Matrix<double, 5, 1>;  // in the order of the equation's terms
  Eigen::Matrix<double, 5, 5> A = Eigen::Matrix<double, 5, 5>::Zero();
  Scales b = Scales::Zero();
  double power = 0, rest = 0;  // of all cells; of the residual with the best scales
  double cells = 0;            // 0: the equation is of no use
  double left(const Scales& x) const { return power - 2 * b.dot(x) + x.dot(A * x); }
};

struct ScaleFactors {
  ScaleRatio R_s, L, psi_f;  // of the voltage
  ScaleRatio K_t_J, T_load;  // of the torque: K_t/J, and the load beside J
  double zero_e = 0;         // rad, direction of psi
  // Voltage that turns with the speed beside another zero of the angle, in halves of the turn from
  // row to row, to first order. A tick's voltage read as a mean gives -1, a mean read as a tick's
  // 1.
  ScaleRatio turned;
  double voltage_share = 0;  // of the voltage's power that the fit explains
  // The same share for the means of the cells. The loop's response to its sensors' noise is in the
  // power of the rows and not in these means, so it does not affect this check of the frame.
  double cell_share = 0;
  double emf_share = 0;        // of the declared EMF, over that of the cells' voltage
  double rounded_share = 0;    // of the cells' voltage, unexplained by the rounding of the angle
  double torque_share = 0;     // of the torque's power that i_q explains beside the frictions
  double mean_interval_e = 0;  // rad, electrical, between rows (rms)
  // At a constant speed: mean of -K_t i_q omega_m over its standard deviation; 0: the speed varies.
  double braking = 0;
  CellPower voltage;  // R_s, L, psi_f along d and q, dead time
  CellPower torque;   // K_t, T_load, T_C, b, T_0
};

// Another reading of the signals of a log.
struct Reading {
  double angle_factor = 1;  // of theta_m
  bool mirrored = false;    // currents: two phases swapped
  double current_turn = 0;  // rad, currents turned (phases in another order)
  // The log holds them as d, q: they do not turn with another angle.
  bool current_stands = false, voltage_stands = false;
  bool voltage_of_tick = false;  // the value at its row, not the mean up to the next row
};

ScaleFactors scale_factors(const Record& record, const DriveFacts& facts, const Reading& as = {});

}  // namespace twinrate
