// The effects that the estimator compensates (used_in = "model" or "both"), in addition to the
// equations of the machine.
//
//   seen      a measurement without the known errors of the sensors and without the known voltage
//             loss, so that the equations of every filter hold for it
//   load      known part of the load at a state, Nm
//   torque    load less the torque of known flux, Nm: the prediction of a filter with a load state
//             uses it
//
// A known flux psi_k(i_dq) beyond L i + psi_f takes the voltage, in mid-interval:
//
//   u_k = omega_e [-psi_k_q; psi_k_d] + d psi_k/d i_dq i_dq'
//
// with i_dq' of the whole machine. A filter that predicts with L alone then predicts as if psi_k
// were in its equations. The torque of psi_k counts as load in the prediction, not in the estimated
// load.
//
// SensingUndo turns late currents to t_k. Over the lag, one sample at most, they also change in
// rotor axes, at the rate of the machine under the voltage of this sample. A voltage that acts late
// (signal_lag) is a weighted mean of this sample's and the one before, up to a lag of one sample.
// A shaft (torsion, backlash) is not predicted: it remains in the estimated load.
#pragma once
#include "model/effects/undo.hpp"
#include "model/machine.hpp"

namespace twinrate {

class KnownEffects {
 public:
  // Without effects.
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
  // Adds the change of late currents in rotor axes over the lag, under the voltage of `s`.
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
