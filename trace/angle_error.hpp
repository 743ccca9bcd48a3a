// Whether a claim of another inertia, or of a shaft, lowers the torque's error by more than it would
// lower an error of the angle.
//
// An error n of the angle makes J n'' of torque of a rigid drive, and Z n of one with a shaft:
//
//   Z / (J s^2) = (J_motor + F J_load) / J,   F = (d s + k) / (J_load s^2 + d s + k)
//
// Where J_motor < J most of it is less. The residual without the claim, through this filter, is what
// the claim would leave if all of that residual came from the angle, whatever its spectrum.
//
// An angle that rings at one frequency (counts that pass at nearly a multiple of the log's rate, a
// vibration) and the controller's answer to it agree with some shaft: three numbers fit one line. So
// each frequency counts once, however loud it is.
#pragma once
#include <Eigen/Core>

#include "model/effects/physics.hpp"
#include "trace/dictionary.hpp"
#include "trace/fit.hpp"

namespace twinrate {

struct AngleErrorFall {
  bool lighter = false;  // less inertia stays at the motor
  double share = 0;      // of its energy that the claim would take off an error of the angle
  // ln of what the claim leaves over what it would leave of such an error: energies, mean over
  // frequencies. NaN: the runs are too short for a frequency.
  double log_ratio = 0;
};

// `with`, `without`: whitened torque residuals; of the runs those that judge.
AngleErrorFall fall_of_angle_error(const Members& claimed, const Eigen::VectorXd& with,
                                   const Members& others, const Eigen::VectorXd& without,
                                   const MachineParameters& machine, const Runs& runs, double T_s);

}  // namespace twinrate
