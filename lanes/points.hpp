// Points and results of the lane engine. Without Eigen: this header is compiled with the flags of
// every instruction set.
#pragma once
#include <cstddef>
#include <cstdint>

#include "core/covariance_form.hpp"

namespace twinrate::lanes {

// The policies of core/rates.hpp, with equal numbers.
enum class Policy : int {
  kPaper = 0,
  kImmediate = 1,
  kExtrapolate = 2,
  kRotate = 3,
  kRotorFrame = 4,
};

// One run of one drive.
struct Point {
  double omega_e_ref_rad_s = 400;  // final reference, slewed at `slew_rad_s2` (0: a step)
  double slew_rad_s2 = 16000;
  int n = 5;
  Policy policy = Policy::kPaper;
  std::uint64_t seed = 1;
  bool flying = false;                       // plant and filter start at the reference speed
  double full_until_s = 0;                   // n = 1 before this time
  double T_load_Nm = 0, load_slew_Nm_s = 0;  // with a slew the load starts from 0
  double duration_s = 2, settle_s = 0.5;     // window of the figures: [settle_s, duration_s]
};

// Figures as defined in docs/conventions.md. Run and figures end at the loss.
struct PointResult {
  bool locked = false;
  double angle_error_rms_rad = 0, angle_error_max_rad = 0;
  double lost_at_s = -1;  // -1: not lost
};

// Settings common to all points.
struct LaneSettings {
  double T_s = 0, R_s = 0, L = 0, psi_f = 0, J = 0, B = 0, n_p = 0, theta_e_start = 0;
  double i_noise_rms = 0, i_lsb = 0, v_dc = 0;
  double Q[4] = {}, R[2] = {}, P0[4] = {};
  bool rk4 = false;  // prediction: Runge-Kutta 4, else Euler
  CovarianceForm covariance = CovarianceForm::kJoseph;
  double current_bandwidth_Hz = 0, speed_bandwidth_Hz = 0, i_max = 0, i_d_ref = 0;
  bool decoupling = true;
  int plant_steps = 1;  // of lanes/plant.hpp, in an interval
};

}  // namespace twinrate::lanes
