// Constants of a tick, equal for all lanes, computed once from LaneSettings.
//
// S: double, or a row of lanes with equal numbers. A row is a memory operand of an instruction; a
// number needs a broadcast first.
#pragma once
#include "estimator/kernels/ekf_sensorless_kernel.hpp"
#include "lanes/points.hpp"

namespace twinrate::lanes {

template <class S>
struct LaneConstants {
  // Plant: lanes/plant.hpp, of one half step tau.
  S tau, inv_tau;  // tau, 1/tau
  S b, a;          // psi_f/L, tau R_s/L
  S k_T, B, load;  // tau^2 3/2 n_p^2 psi_f/J, tau B/J, tau^2 n_p/J
  S g;             // tau/L
  // Currents at the middle: shares of i_0, of tau u/L, of [cos, sin] and their rates at 0 and 1.
  S mid_decay, mid_u, mid_0, mid_d0, mid_1, mid_d1;
  // At the end: also of [cos, sin] at 2; of A and A_d at 0 and 1 through W and the angle at 1.
  S end_decay, end_u, end_0, end_d0, end_1, end_d1, end_2;
  S late_0, late_d0, late_1, late_d1;
  // Sensors.
  S counts_an_A, half_sqrt3_counts_an_A, noise_counts;  // a count: i_lsb, or 1 A without an ADC
  S third_A_a_count, inv_sqrt3_A_a_count;
  // Filter.
  kernel::SensorlessConstants<S> filter;
  S Q[4], R[2];
  S inv_n_p, T_s;
  // Controller.
  S K_p_speed, K_i_speed, k_awu_speed, K_p, K_i, k_awu;  // K_i, k_awu: times T_s
  S i_d_ref, i_q_max, advance_s, u_max, u_max_square, L, psi_f;
};

// Switches common to all lanes.
struct LaneSwitches {
  int plant_steps;
  bool noise, adc, rk4;
  CovarianceForm covariance;
};

LaneConstants<double> lane_constants(const LaneSettings& settings);
LaneSwitches lane_switches(const LaneSettings& settings);

}  // namespace twinrate::lanes
