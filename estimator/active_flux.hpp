// Active-flux filter: with L_q on both axes, the remaining flux of a salient machine lies on the
// d axis.
//
//   psi_s = L_q i + psi_a [cos theta_e; sin theta_e]     stator flux, stationary frame, Wb
//   psi_a = psi_f + (L_d - L_q) i_d                      active flux, Wb
//   u     = R_s i + L_q i' + e                           V
//   e     = d/dt (psi_a [cos theta_e; sin theta_e])
//         = omega_e psi_a [-sin theta_e; cos theta_e]    while i_d is constant
//
// The model is exact for a salient rotor in steady state. While i_d changes, e has a component
// along d, which turns the estimated angle. The speed is the rate of the angle of e.
// State, input, output, prediction, correction, background: estimator/backemf_filter.hpp with
// L_alpha = L_beta = L_q. Angle and speed: estimator/emf_angle.hpp.
// Source: Boldea, Paicu, Andreescu, active flux concept; docs/theory/ipmsm-filters.md.
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
  double direct_start_within() const override { return 0; }  // no EMF at standstill
};

}  // namespace twinrate
