// The filter that Kim et al. print, with corrected signs: L_q on alpha and L_d on beta at every
// angle of the rotor.
//
// State, input, output, prediction, correction, background: estimator/backemf_filter.hpp with
// L_alpha = L_q, L_beta = L_d. Angle and speed: estimator/emf_angle.hpp.
//
// The model is exact on the fixed-axes machine alone (plant.saliency = "fixed_axes"). On a salient
// rotor its angle is wrong by 30 deg under load (docs/theory/ipmsm-filters.md).
// The defaults are the printed Q_0, R_0, P_0. The printed Q_0 gives 80e3 and 10e3 to the two axes
// of a vector that turns; Q_diag = [2e3, 2e3, 80e3, 80e3] is the sound form.
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
  double direct_start_within() const override { return kStartWithin; }
};

}  // namespace twinrate
