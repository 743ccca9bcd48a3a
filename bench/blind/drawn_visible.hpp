// The true effects that a log can show. This test shares no code with the tracer.
//
// The equations of the declared machine, in rotor axes: voltages over rows k to k + 1, torque over
// three rows:
//
//   e_d = u_d - R_s i_d - L_d di_d/dt + omega_e L_q i_q
//   e_q = u_q - R_s i_q - L_q di_q/dt - omega_e (L_d i_d + psi_f)
//   e_T = T_em - T_load - B omega_m - J domega_m/dt
//
// n: residual of the readings if nothing is missing. c: contribution of an effect alone to the
// residual, in the same run without noise, averaged over a row. Both are averaged over windows of h
// rows and whitened by the autocorrelation of n. With n white and of size one, the error of the
// true model without the effect is |n + c|^2, that of the true model |n|^2. The difference has the
// mean |c|^2 and the standard deviation 2 |c|. The effect is visible if |c|/2 > 3.1 on a quarter of
// the rows (p < 0.001) at the best h. The part of c that the larger true effects explain, with
// their sizes free, is subtracted first.
//
// Effects on the samples count as visible: lost and repeated rows, and, if the log has phase
// currents, steps and limit of the converter.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "bench/blind/drawn_log.hpp"

namespace twinrate::blind {

// |c|/2 of each true kind, on a quarter of the rows at the best h; infinite for a visible effect on
// the samples.
using Deviations = std::map<std::string, double>;
Deviations deviations_in_log(const DrawnCase& which, const std::vector<std::string>& truth);

// The visible kinds, in the order of `truth`.
std::vector<std::string> visible_kinds(const Deviations& deviations,
                                       const std::vector<std::string>& truth);

}  // namespace twinrate::blind
