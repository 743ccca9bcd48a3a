// What the model knows beyond the machine's equations (effects with used_in = model or both), as a
// filter uses it.
//
//   seen      a measurement with the sensors' known errors undone and the known voltage loss taken
//             off, so that every filter's equations hold for it
//   torque    known part of the load at a state; filters that have a load state predict with it
#pragma once
#include "model/effects/undo.hpp"

namespace twinrate {

class KnownEffects {
 public:
  // `current_sensors`: 2 or 3, as sensors.current_sensors.
  KnownEffects(const Effects& effects, int n_p, int current_sensors, double T_s);

  bool none() const { return none_; }
  // `last`: the estimate before, from whose state the lost voltage is predicted.
  Measurement seen(const Measurement& m, const Estimate& last) const;
  double torque(const OperatingPoint& point) const { return sum_at(torque_, point).T_load; }

 private:
  SensingUndo undo_;
  Effects torque_, voltage_;
  bool none_;
  int n_p_;
  double T_s_;
};

}  // namespace twinrate
