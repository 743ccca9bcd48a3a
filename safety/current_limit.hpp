// The reduced current limit of state DERATE. It acts on the voltage of a command, so it works
// without the controller, which may not know of it.
//
//   i'  = i + T_s/L (u - R_s i - j omega_e L i - j omega_e psi_f)   predicted over the interval
//   u'  = u                              if |i'| <= i_max
//   u'  = u + L/T_s (i_max/|i'| - 1) i'  else: the current reaches the limit exactly
//
// d and q components, each with its own L, in the frame into which the command's currents were
// turned. The voltage limit of the modulator follows.
#pragma once
#include <array>

namespace twinrate {

struct CurrentLimit {
  using Dq = std::array<double, 2>;
  double T_s = 0, R_s = 0, L_d = 0, L_q = 0, psi_f = 0;

  // The voltage u'. `i` at the start of the interval, A; `omega_e` of the frame, rad/s.
  Dq limited(const Dq& u, const Dq& i, double omega_e, double i_max) const;
};

}  // namespace twinrate
