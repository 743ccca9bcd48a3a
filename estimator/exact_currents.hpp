// Currents of a salient machine after one period, in the rotor axes of its end.
//
//   L_d i_d' = u_d - R_s i_d + omega_e L_q i_q                                        Niewiara (10)
//   L_q i_q' = u_q - R_s i_q - omega_e (L_d i_d + psi_f)                                       (11)
//
// With omega_e constant they are linear, and a voltage that is constant in stator axes turns
// backwards in rotor axes: [i_dq; u_dq]' = A [i_dq; u_dq] + B omega_e psi_f. `u_dq`: in the axes of
// the start.
#pragma once
#include "model/discretise_exact.hpp"
#include "model/frames.hpp"
#include "model/machine.hpp"

namespace twinrate {

inline Vec2 exact_rotor_currents(const MachineParameters& m, const Vec2& i_dq, double omega_e,
                                 const Vec2& u_dq, double T_s) {
  Eigen::Matrix4d A;
  A << -m.R_s / m.L_d, omega_e * m.L_q / m.L_d, 1 / m.L_d, 0,  //
      -omega_e * m.L_d / m.L_q, -m.R_s / m.L_q, 0, 1 / m.L_q,  //
      0, 0, 0, omega_e,                                        //
      0, 0, -omega_e, 0;
  const Eigen::Vector4d B(0, -1 / m.L_q, 0, 0);
  const auto d = discretise_exact<4, 1>(A, B, T_s);
  Eigen::Vector4d z;
  z << i_dq, u_dq;
  const Eigen::Vector4d next = d.A * z + d.B * (omega_e * m.psi_f);
  return next.head<2>();
}

}  // namespace twinrate
