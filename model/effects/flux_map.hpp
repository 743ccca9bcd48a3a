// Flux linkages that effects add in rotor axes, with their slope over the current.
//
//   psi = sum psi_dq(i),  slope = d psi/d i_dq (central differences)
//
// The voltage and torque of a machine with [L_d i_d + psi_f, L_q i_q] + psi follow from both:
//   voltage   u_dq - R_s i_dq = (diag(L_d, L_q) + slope) i_dq' + omega_e [-psi_q, psi_d]
//   torque    3/2 n_p (psi_d i_q - psi_q i_d), in which the added part is minus flux_load()
#pragma once
#include <Eigen/LU>

#include "model/effects/effect.hpp"
#include "model/machine.hpp"

namespace twinrate {

struct FluxMap {
  Vec2 psi = Vec2::Zero();                          // Wb
  Eigen::Matrix2d slope = Eigen::Matrix2d::Zero();  // H
};

// `on_flux`: effects that act on the flux. No allocation.
inline FluxMap flux_map(const Effects& on_flux, OperatingPoint point) {
  constexpr double kStep = 1e-4;  // A: rounding 1e-12 of the flux, truncation of a current of 10 A
                                  // 1e-10
  FluxMap map;
  map.psi = sum_at(on_flux, point).psi_dq;
  const Vec2 i_dq = point.i_dq;
  for (int axis = 0; axis < 2; ++axis) {
    point.i_dq = i_dq + kStep * Vec2::Unit(axis);
    const Vec2 above = sum_at(on_flux, point).psi_dq;
    point.i_dq = i_dq - kStep * Vec2::Unit(axis);
    map.slope.col(axis) = (above - sum_at(on_flux, point).psi_dq) / (2 * kStep);
  }
  return map;
}

// d psi/d i_dq of the whole machine.
inline Eigen::Matrix2d incremental_inductance(const MachineParameters& m, const FluxMap& added) {
  Eigen::Matrix2d L = added.slope;
  L(0, 0) += m.L_d;
  L(1, 1) += m.L_q;
  return L;
}

// d/dt of i_dq under u_dq, of a machine with the added flux.
inline Vec2 current_rate(const MachineParameters& m, const FluxMap& added, const Vec2& i_dq,
                         const Vec2& u_dq, double omega_e) {
  const Vec2 psi = Vec2(m.L_d * i_dq[0] + m.psi_f, m.L_q * i_dq[1]) + added.psi;
  return incremental_inductance(m, added).inverse() *
         (u_dq - m.R_s * i_dq - omega_e * Vec2(-psi[1], psi[0]));
}

// Nm that the added flux takes from the shaft, as a part of T_load.
inline double flux_load(int n_p, const Vec2& psi, const Vec2& i_dq) {
  return -1.5 * n_p * (psi[0] * i_dq[1] - psi[1] * i_dq[0]);
}

}  // namespace twinrate
