// The filter that Kim et al. print, its signs mended: L_q on alpha, L_d on beta, whatever the
// rotor's angle. Exact on their fixed-axes machine alone (plant.saliency = "fixed_axes"); on a
// salient rotor its angle is 30 deg off under load, which docs/theory/ipmsm-filters.md explains.
//
// Defaults are the printed Q_0, R_0, P_0. The printed Q_0 holds 80e3 and 10e3 for the two axes of a
// vector that turns; Q_diag = [2e3, 2e3, 80e3, 80e3] is the sound form.
// Equations and shapes: estimator/backemf_filter.hpp; angle and speed: estimator/emf_angle.hpp.
#pragma once
#include "estimator/backemf_filter.hpp"

namespace twinrate {

class BackEmfPrinted final : public BackEmfFilter {
 public:
  BackEmfPrinted(const MachineParameters& machine, const BackEmfParameters& tuning,
                 Prediction prediction, CovarianceForm covariance, double T_s, KnownStart start)
      : BackEmfFilter(machine, {machine.L_q, machine.L_d}, tuning, prediction, covariance, T_s,
                      start) {}
  std::string_view kind() const override { return "backemf_printed"; }
};

}  // namespace twinrate
