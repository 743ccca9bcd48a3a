// Active-flux filter: L_q on both axes makes the rest of a salient machine's flux lie on the d
// axis.
//
//   psi_s = L_q i + psi_a [cos theta_e; sin theta_e],  psi_a = psi_f + (L_d - L_q) i_d
//   u = R_s i + L_q i' + e,   e = d/dt (psi_a [cos; sin]) = omega_e psi_a [-sin; cos] where i_d is
//   steady
//
// So the model is exact for a salient rotor in steady state; while i_d moves, e has a part along d
// that turns the estimated angle. Speed from the rate of the EMF's angle. Equations and shapes:
// estimator/backemf_filter.hpp; angle and speed: estimator/emf_angle.hpp. Source: Boldea, Paicu,
// Andreescu, active flux concept; physics of docs/theory/ipmsm-filters.md.
#pragma once
#include "estimator/backemf_filter.hpp"

namespace twinrate {

struct ActiveFluxParameters : BackEmfParameters {
  ActiveFluxParameters() {
    // Tuned at 2000 rpm and 0.6 of rated torque, noise 5 mA.
    for (double& q : Q_diag) q = 1e-4;
    Q_diag[2] = Q_diag[3] = 0.5;
    for (double& r : R_diag) r = 1e-3;
    for (double& p : P0_diag) p = 1;
    angle.speed_from = SpeedFrom::kAngleRate;
    angle.lowpass_Hz = 10;  // above 15 Hz some starts by I/f are lost at J = 1e-3
    angle.saliency_in_speed = true;
  }
};

class ActiveFlux final : public BackEmfFilter {
 public:
  ActiveFlux(const MachineParameters& machine, const ActiveFluxParameters& tuning,
             Prediction prediction, CovarianceForm covariance, double T_s, KnownStart start)
      : BackEmfFilter(machine, {machine.L_q, machine.L_q}, tuning, prediction, covariance, T_s,
                      start) {}
  std::string_view kind() const override { return "active_flux"; }
};

}  // namespace twinrate
