#include "safety/current_limit.hpp"

#include <cmath>

namespace twinrate {

CurrentLimit::Dq CurrentLimit::limited(const Dq& u, const Dq& i, double omega_e,
                                       double i_max) const {
  const double i_d = i[0] + T_s / L_d * (u[0] - R_s * i[0] + omega_e * L_q * i[1]);
  const double i_q = i[1] + T_s / L_q * (u[1] - R_s * i[1] - omega_e * (L_d * i[0] + psi_f));
  const double amplitude = std::sqrt(i_d * i_d + i_q * i_q);
  if (amplitude <= i_max) return u;
  const double less = i_max / amplitude - 1;
  return {u[0] + L_d / T_s * less * i_d, u[1] + L_q / T_s * less * i_q};
}

}  // namespace twinrate
