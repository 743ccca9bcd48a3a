// The smallest sizes worth reporting, in proportion to the drive.
//
// The figures are those of a servo motor of 8.1 Nm; those of other drives are scaled by the rated
// torque. If that is not given: torque constant times rated current. If neither is given, the
// figures are used unchanged.
#pragma once
#include <numbers>

#include "model/drive_facts.hpp"
#include "model/effects/physics.hpp"

namespace twinrate {

// Nm; `at_8_Nm`: the figure for a rated torque of 8.1 Nm.
inline double smallest_torque(const DriveFacts& facts, double at_8_Nm) {
  constexpr double kTorqueOfFigures = 8.1;
  const MachineParameters& m = facts.machine;
  const double T_rated = m.T_rated > 0 ? m.T_rated : m.torque_constant() * m.i_rated;
  return T_rated > 0 ? at_8_Nm * T_rated / kTorqueOfFigures : at_8_Nm;
}

// rad/s, mechanical; if it is not given, 0.6 of the speed at which the EMF takes all the voltage.
inline double rated_speed(const DriveFacts& facts) {
  const MachineParameters& m = facts.machine;
  if (m.omega_m_rated > 0) return m.omega_m_rated;
  return 0.6 * facts.v_dc * std::numbers::inv_sqrt3 / (m.n_p * m.psi_f);
}

}  // namespace twinrate
