// Defaults of the controllers for the machine and rates of the drive file (model/per_unit.hpp). Keys
// that the drive file gives win.
//
//   current loop     f_s/25 (FOC); max(f_s/40, 1.1 R_s/(2 pi L_d)) (state feedback): with less
//                    than the open loop a weight would be negative
//   speed loop       f_s/625, at least 2/(2 pi t_m), at most a fifth of the current loop: with less,
//                    rated torque stops the motor before the loop answers
//   i_max            1.5 times the rated current
//   start            current 0.65 psi_f/(L_q - L_d), at most i_max: at 1 no active flux is left; a ramp
//                    with 2 % of the acceleration that this current gives, up to a tenth of the
//                    rated speed; each alignment lasts five times the rotor's settling time, at
//                    least 0.3 s
//   innovation_A     0.8 % of the rated current
//   omega_e_min      12 % of the rated speed
//   gains of lqr     from bandwidths
#pragma once
#include "controller/foc.hpp"
#include "controller/lqr.hpp"

namespace twinrate {

void scale(FocParameters& p, const DriveConfig& config);
void scale(LqrParameters& p, const DriveConfig& config);

}  // namespace twinrate
