// Parameters of a permanent-magnet synchronous machine, and its torque.
//
//   T_em = 3/2 n_p (psi_f + (L_d - L_q) i_d) i_q        (physics: peak-valued, amplitude-invariant)
//   J d omega_m/dt = T_em - B omega_m - T_load          (T_load positive opposes positive omega_m)
#pragma once

namespace twinrate {

class FieldVisitor;

struct MachineParameters {
  double R_s = 0, L_d = 0, L_q = 0, psi_f = 0, J = 0, B = 0;
  int n_p = 0;
  int n_slots = 0;  // 0: not known
  double i_rated = 0, T_rated = 0, omega_m_rated = 0;
  double i_trip = 0;  // amplitude at which the drive switches off; 0: not given

  void fields(FieldVisitor& f);

  double torque(double i_d, double i_q) const {
    return 1.5 * n_p * (psi_f + (L_d - L_q) * i_d) * i_q;
  }
  // Nm per ampere of i_q at i_d = 0.
  double torque_constant() const { return 1.5 * n_p * psi_f; }
};

}  // namespace twinrate
