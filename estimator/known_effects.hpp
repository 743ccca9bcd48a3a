// What the model knows beyond the machine's equations (effects with used_in = model or both), as a
// filter uses it.
//
//   seen      a measurement with the sensors' known errors undone and the known voltage loss taken
//             off, so that every filter's equations hold for it
//   load      known part of the load at a state
//   torque    that, less the torque of known flux: filters that have a load state predict with it
//
// A known flux psi_k(i_dq) beyond L i + psi_f costs the voltage
//   omega_e [-psi_k_q, psi_k_d] + d psi_k/d i_dq i_dq'
// in mid-interval, with i_dq' as the whole machine has it: a filter that predicts with L alone then
// predicts as if it knew psi_k. Its torque counts as load in the prediction, not in the estimated
// load.
//
// Late currents come turned to t_k from SensingUndo; over the lag, one sample at most, they also
// move in rotor axes, at the rate that the machine has under the voltage of this sample. A voltage
// that acts late (signal_lag) is the mix of this sample's with the one before, up to one sample. A
// shaft (torsion, backlash) is not predicted: it stays in the load that filters estimate.
#pragma once
#include "model/effects/undo.hpp"

namespace twinrate {

class KnownEffects {
 public:
  // Knows nothing.
  KnownEffects() : KnownEffects({}, {.n_p = 1}, 3, 0) {}
  // `current_sensors`: 2 or 3, as sensors.current_sensors.
  KnownEffects(const Effects& effects, const MachineParameters& machine, int current_sensors,
               double T_s);

  bool none() const { return none_; }
  // `last`: the estimate before, from whose state the lost voltage is predicted. `before`: the
  // measurement before, as measured.
  Measurement seen(const Measurement& m, const Estimate& last, const Measurement& before) const;
  double load(const OperatingPoint& point) const { return sum_at(torque_, point).T_load; }
  double torque(const OperatingPoint& point) const {
    return known_load(torque_, point, machine_.n_p);
  }

 private:
  // Of late currents: what they move in rotor axes over the lag under the voltage of `s`.
  void carry_currents(Measurement& s, const Estimate& last) const;
  Vec2 flux_voltage(OperatingPoint point, const Vec2& u_dq) const;

  SensingUndo undo_;
  Effects torque_, voltage_, flux_;
  bool none_;
  MachineParameters machine_;
  double T_s_;
  double voltage_lag_;  // in samples, up to 1
};

}  // namespace twinrate
