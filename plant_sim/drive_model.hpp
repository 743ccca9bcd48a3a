// The drive's differential equations in rotor axes, with every effect of the config added.
//
//   x = [i_d, i_q, omega_m, theta_m]
//   L_d i_d' = u_d - R_s i_d + n_p omega_m L_q i_q            u_dq = R(-n_p theta_m) u_alphabeta -
//   effects L_q i_q' = u_q - R_s i_q - n_p omega_m (L_d i_d + psi_f) J omega_m' = T_em - B omega_m
//   - T_load - effects,   theta_m' = omega_m
#pragma once
#include "model/effects/effect.hpp"
#include "model/machine.hpp"

namespace twinrate {

using PlantState = Eigen::Vector4d;

// What is held constant over one sampling interval.
struct PlantInput {
  double t_k = 0;                   // start of the interval
  Vec2 u_alphabeta = Vec2::Zero();  // applied voltage
  double T_load = 0;                // external load
};

// Where the machine's saliency sits: in the rotor, as in every real machine, or on the stator's
// axes (plant_sim/fixed_axes.hpp).
enum class Saliency : int { kRotor = 0, kFixedAxes = 1 };

class DriveModel {
 public:
  DriveModel(const MachineParameters& machine, Effects effects,
             Saliency saliency = Saliency::kRotor)
      : machine_(machine), effects_(std::move(effects)), saliency_(saliency) {}

  PlantState rate(const PlantState& x, const PlantInput& input, double t_in_interval) const;
  // External load and effects together, at a state.
  double total_load(const PlantState& x, const PlantInput& input, double t_in_interval) const;
  double torque(const Vec2& i_dq) const;
  const MachineParameters& machine() const { return machine_; }

 private:
  Contribution effects_at(const PlantState& x, double t) const;

  MachineParameters machine_;
  Effects effects_;
  Saliency saliency_;
};

}  // namespace twinrate
