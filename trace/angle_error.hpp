// Compares the fall of the torque error that a claimed inertia or shaft causes with the fall that
// it would cause in an error of the angle.
//
// An error n of the angle makes a torque J n'' in a rigid drive, and Z n in a drive with a shaft:
//
//   Z / (J s^2) = (J_motor + F J_load) / J,   F = (d s + k) / (J_load s^2 + d s + k)
//
// If J_motor < J, this filter reduces most spectra. The filter is applied to the residual without
// the claim. Its output is the residual that the claim would leave if the whole residual were an
// error of the angle, whatever its spectrum.
//
// An angle error at one frequency (counts that pass at nearly a multiple of the log's rate, a
// vibration) and the controller's response to it agree with some shaft, because three parameters
// fit one spectral line. So each frequency has the same weight, whatever its energy.
#pragma once
#include <Eigen/Core>

#include "model/effects/physics.hpp"
#include "trace/dictionary.hpp"
#include "trace/fit.hpp"

namespace twinrate {

struct AngleErrorFall {
  bool lighter = false;  // the inertia at the motor becomes smaller
  double share = 0;      // of the energy of an angle error that the claim would remove
  double loose = 0;      // the same while the load is loose in a gap: the motor is alone
  // ln of the ratio of two energies, mean over the frequencies: the residual with the claim over
  // the residual that the claim would leave of an angle error. NaN: the runs are too short.
  double log_ratio = 0;
};

// True if the inertia at the motor is smaller with the claim.
bool is_lighter(const Members& claimed, const Members& others, const MachineParameters& machine);

// `with`, `without`: whitened torque residuals. Only the runs of held-out rows count.
AngleErrorFall fall_of_angle_error(const Members& claimed, const Eigen::VectorXd& with,
                                   const Members& others, const Eigen::VectorXd& without,
                                   const MachineParameters& machine, const Runs& runs, double T_s);

}  // namespace twinrate
