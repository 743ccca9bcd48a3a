// The idealised machine that Kim et al. print: its two inductances are fixed to the axes of the
// stator and do not turn with the rotor (plant.saliency = "fixed_axes").
//
//   u_alpha = R_s i_alpha + L_q i_alpha' - omega_e psi_f sin theta_e       q^s = alpha          (1)
//   u_beta  = R_s i_beta  + L_d i_beta'  + omega_e psi_f cos theta_e       d^s = -beta          (1)
//   T_em    = 3/2 n_p psi_f i_q
//
// No real interior-magnet machine is like this: the inductances of a salient rotor turn with it.
// The model serves as the machine on which the paper's filter is exact. The paper gives no torque;
// with inductances that do not depend on the angle, the power into the EMF is the power of the
// magnets' torque alone.
#pragma once
#include "model/frames.hpp"
#include "model/machine.hpp"

namespace twinrate {

// d/dt of i_dq, rotor axes, under u_dq (losses by effects already subtracted).
inline Vec2 fixed_axes_current_rate(const MachineParameters& m, const Vec2& i_dq, const Vec2& u_dq,
                                    double omega_e, double theta_e) {
  const Vec2 emf_dq(0, omega_e * m.psi_f);
  const Vec2 u_L = inverse_park(u_dq - m.R_s * i_dq - emf_dq, theta_e);
  const Vec2 rate = park(Vec2(u_L[0] / m.L_q, u_L[1] / m.L_d), theta_e);
  return {rate[0] + omega_e * i_dq[1], rate[1] - omega_e * i_dq[0]};
}

inline double fixed_axes_torque(const MachineParameters& m, double i_q) {
  return m.torque_constant() * i_q;
}

}  // namespace twinrate
