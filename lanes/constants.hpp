// The numbers that a tick needs, the same for every lane, worked out once from LaneSettings.
//
// S: double, or a row of lanes that all hold the same number: a row can be an operand of an
// instruction as it lies in memory, a number has to be spread first.
#pragma once
#include "estimator/kernels/ekf_sensorless_kernel.hpp"
#include "lanes/points.hpp"

namespace twinrate::lanes {

template <class S>
struct LaneConstants {
  // Plant, of one Runge-Kutta step h: decay exp(-h/2 R_s/L), its square and its half, integrals of
  // exp(-(1 - t) h R_s/L) times the parabolas through 0, 1/2, 1.
  S h, half_h, decay_half, decay_full, half_decay_half;
  S w_0, w_m, w_1;
  S b, k_T, B, g, load;  // h psi_f/L, h 3/2 n_p^2 psi_f/J, h B/J, h/L, h n_p/J
  // Sensors.
  S i_noise_rms, i_lsb, inv_lsb;
  // Filter.
  kernel::SensorlessConstants<S> filter;
  S Q[4], R[2];
  S inv_n_p, T_s;
  // Controller.
  S K_p_speed, K_i_speed, k_awu_speed, K_p, K_i, k_awu;
  S i_d_ref, i_q_max, advance_s, u_max, L, psi_f;
  // Figures.
  S off_ticks_max, constant_ticks_min;
};

// What is decided for all lanes.
struct LaneSwitches {
  int plant_steps;
  bool noise, adc, rk4;
  CovarianceForm covariance;
};

LaneConstants<double> lane_constants(const LaneSettings& settings);
LaneSwitches lane_switches(const LaneSettings& settings);

}  // namespace twinrate::lanes
