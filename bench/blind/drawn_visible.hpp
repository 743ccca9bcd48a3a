// Which of the true effects a log can show. It shares no code with the tracer.
//
// The equations of the declared machine, in rotor axes, on rows k to k + 1, and of three rows:
//
//   e_d = u_d - R_s i_d - L_d di_d/dt + omega_e L_q i_q
//   e_q = u_q - R_s i_q - L_q di_q/dt - omega_e (L_d i_d + psi_f)
//   e_T = T_em - T_load - B omega_m - J domega_m/dt
//
// n: what the readings of the log leave of them when nothing is missing. c: what an effect alone
// adds to them in the same run without noise, averaged over a row. Both are averaged over
// windows of h rows and whitened by the autocorrelation of n. With n white and of size one the
// error of the true model without the effect is |n + c|^2, that of the true model |n|^2; the
// difference has the mean |c|^2 and the standard deviation 2 |c|. The effect can be seen where
// |c|/2 > 3.1 on a quarter of the rows (p < 0.001) at the best h. What the larger of the true
// effects explain of c, by their sizes alone, is taken off first.
//
// Effects on the samples count as seen: lost and repeated rows, and steps and limit of the
// converter where the log has phase currents.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "bench/blind/drawn_log.hpp"

namespace twinrate::blind {

// Of each true kind: |c|/2 on a quarter of the rows at the best h; infinite on the samples of a log
// that has them.
using Deviations = std::map<std::string, double>;
Deviations deviations_in_log(const DrawnCase& which, const std::vector<std::string>& truth);

// Those that can be seen, in the order of `truth`.
std::vector<std::string> visible_kinds(const Deviations& deviations,
                                       const std::vector<std::string>& truth);

}  // namespace twinrate::blind
