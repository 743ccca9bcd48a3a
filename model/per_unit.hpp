// The sizes of a machine in which defaults are written: a default that fits one machine then fits
// another.
//
//   i        rated current, peak, A
//   omega_e  rated speed, electrical, rad/s
//   e        EMF at that speed, V                      psi_f omega_e
//   T        rated torque, Nm
//   step     change of omega_e at rated torque in one control period, rad/s   n_p T T_s/J
//   t_m      time from standstill to the rated speed at rated torque, s
//
// A rating that the drive file leaves out follows from the others: T = K_t i, i = T/K_t; without
// both, i is a tenth of the current that v_dc drives through R_s. The rated speed is then the one
// whose EMF is 60 % of the voltage limit.
#pragma once
#include <numbers>

#include "model/machine.hpp"

namespace twinrate {

struct PerUnit {
  double i = 0, omega_e = 0, e = 0, T = 0, step = 0, t_m = 0;
};

inline PerUnit per_unit(const MachineParameters& m, double v_dc, double T_s) {
  const double u_max = v_dc * std::numbers::inv_sqrt3;
  PerUnit base;
  base.i = m.i_rated > 0   ? m.i_rated
           : m.T_rated > 0 ? m.T_rated / m.torque_constant()
                           : 0.1 * u_max / m.R_s;
  base.T = m.T_rated > 0 ? m.T_rated : m.torque_constant() * base.i;
  base.omega_e = m.omega_m_rated > 0 ? m.n_p * m.omega_m_rated : 0.6 * u_max / m.psi_f;
  base.e = m.psi_f * base.omega_e;
  base.step = m.n_p * base.T * T_s / m.J;
  base.t_m = m.J * base.omega_e / (m.n_p * base.T);
  return base;
}

}  // namespace twinrate
