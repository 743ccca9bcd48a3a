// The differential equations of the drive in rotor axes, with every effect of the config.
//
//   state   x = [i_d, i_q, omega_m, theta_m]           A, A, rad/s, rad (mechanical)
//   input   u_alphabeta                                V, constant over one sampling interval
//
//   v_dc(t)    = v_dc + effects on the bus
//   u_dq       = R(-n_p theta_m) u_alphabeta v_dc(t)/v_dc
//   L_d i_d'   = u_d - R_s i_d + n_p omega_m L_q i_q               - effects on the voltage
//   L_q i_q'   = u_q - R_s i_q - n_p omega_m (L_d i_d + psi_f)     - effects on the voltage
//   T_em       = 3/2 n_p (psi_f + (L_d - L_q) i_d) i_q
//   J omega_m' = T_em - B omega_m - T_load                         - effects on the torque
//   theta_m'   = omega_m
//
// Effects on the flux add psi_k(i_dq) to [L_d i_d + psi_f, L_q i_q]: L becomes L + d psi_k/d i_dq;
// EMF and torque contain the whole flux (model/effects/flux_map.hpp).
//
// An elastic shaft (effects torsion, backlash) adds two states. The motor then has the inertia
// J - J_load, and T_shaft takes the place of the external load, which acts on the load's side with
// the effects that belong to it (model/effects/shaft.hpp):
//
//   delta              = theta_m - theta_load
//   delta'             = omega_m - omega_load
//   J_load omega_load' = T_shaft - T_load
//
// Effects on sensors are not part of these equations: sensing_at().
#pragma once
#include <optional>

#include "model/effects/effect.hpp"
#include "model/effects/shaft.hpp"
#include "model/machine.hpp"
#include "model/plant_facts.hpp"
#include "model/rotor_axes.hpp"
#include "plant_sim/switched_inverter.hpp"

namespace twinrate {

using PlantState = Eigen::Vector4d;
using TwoMassState = Eigen::Matrix<double, 6, 1>;  // PlantState, delta, omega_load

// Inputs, constant over one sampling interval.
struct PlantInput {
  double t_k = 0;                   // start of the interval
  Vec2 u_alphabeta = Vec2::Zero();  // applied voltage at the nominal bus voltage
  double T_load = 0;                // external load
  // Of a switched inverter: the legs' states in this segment, instead of u_alphabeta.
  std::optional<LegStates> legs;
  RotorAxes rotor_axes = {};  // at t_k, if the caller has them
};

class DriveModel {
 public:
  // `v_dc`: nominal bus voltage.
  DriveModel(const MachineParameters& machine, const Effects& effects, double v_dc,
             Saliency saliency = Saliency::kRotor);

  PlantState rate(const PlantState& x, const PlantInput& input, double t_in_interval) const;
  // Of a drive that has_shaft().
  TwoMassState two_mass_rate(const TwoMassState& x, const PlantInput& input,
                             double t_in_interval) const;
  bool has_shaft() const { return shaft_.J_load > 0; }
  // Behind a rotor at rest or at constant speed at drive time `t`. Zero without a shaft.
  ShaftState shaft_at_rest(double t, double omega_m, double T_load) const;
  // External load and effects together, at a state.
  double total_load(const PlantState& x, const PlantInput& input, double t_in_interval) const;
  double torque(const Vec2& i_dq) const;
  double bus_voltage(const PlantState& x, const PlantInput& input, double t_in_interval) const;
  // Error of the readings of currents and angle: i_abc and theta_m.
  Contribution sensing_at(const PlantState& x, const PlantInput& input, double t_in_interval) const;
  // No effect acts on the reading of the currents; of the angle.
  bool currents_are_read_true() const { return !acts_on_currents_; }
  bool angle_is_read_true() const { return !acts_on_angle_; }
  const MachineParameters& machine() const { return machine_; }
  // The machine's own equations and no effect in them: plant_sim/plain_machine.hpp.
  bool is_plain() const;
  // The applied voltage, if it is constant over the interval (before effects): no leg is in dead
  // time.
  std::optional<Vec2> constant_voltage(const PlantInput& input) const;
  // The fastest rate of the equations, 1/s: decay of the currents, shaft.
  double fastest_rate() const;

 private:
  // `T_external`: the external load, or the shaft's torque; `J`: inertia on the rotor's side.
  PlantState motor_rate(const PlantState& x, const PlantInput& input, double t_in_interval,
                        double T_external, double J) const;
  double load_behind_shaft(const OperatingPoint& point) const;
  OperatingPoint point(const PlantState& x, const PlantInput& input, double t_in_interval) const;

  MachineParameters machine_;
  ShaftFacts shaft_;
  Effects on_equations_, on_load_, on_flux_, on_bus_, on_sensors_;
  bool acts_on_currents_, acts_on_angle_;
  double v_dc_;
  Saliency saliency_;
};

}  // namespace twinrate
