// The numbers that a tick needs, the same for every lane, worked out once from LaneSettings.
#pragma once
#include "estimator/kernels/ekf_sensorless_kernel.hpp"
#include "lanes/points.hpp"

namespace twinrate::lanes {

struct LaneConstants {
  // Plant, of one Runge-Kutta step h: currents, speed, voltage.
  int plant_steps;
  double h, decay_half;  // exp(-h/2 R_s/L)
  double w_0, w_m, w_1;  // integrals of exp(-(1 - t) h R_s/L) times the parabolas through 0, 1/2, 1
  double b, k_T, B, g, load;  // h psi_f/L, h 3/2 n_p^2 psi_f/J, h B/J, h/L, h n_p/J
  // Sensors.
  double i_noise_rms, i_lsb, inv_lsb;
  // Filter.
  kernel::SensorlessConstants<double> filter;
  double Q[4], R[2];
  double n_p, inv_n_p, T_s;
  // Controller.
  double K_p_speed, K_i_speed, k_awu_speed, K_p, K_i, k_awu;
  double i_d_ref, i_q_max, advance_s, u_max, L, psi_f;
  // Figures.
  double off_ticks_max, constant_ticks_min;
};

LaneConstants lane_constants(const LaneSettings& settings);

}  // namespace twinrate::lanes
