// The physics of an effect: the interface that the plant simulates and that estimator and
// controller predict and undo. It runs at every stage of the integrator and on every tick: no
// clock, no allocation, no state.
#pragma once
#include "model/operating_point.hpp"

namespace twinrate {

// Properties of the inverter's legs, for a plant that switches them one by one.
struct LegFacts {
  double dead_time = 0;  // s
};

// The rotor's second mass behind a shaft: its share of machine.J, and the shaft between.
//   T_shaft = K (delta less the gap) + D delta',  0 inside the gap;  delta = theta_m - theta_load
//
// The flanks of a gap only push: if the sum would pull, the torque is 0.
struct ShaftFacts {
  double J_load = 0;     // kgm2, of machine.J
  double stiffness = 0;  // Nm/rad; 0: no shaft, one rigid mass
  double damping = 0;    // Nms/rad
  double gap = 0;        // rad, whole free play
};

// Errors of the samples themselves, beyond an addition to a reading.
struct SamplingFacts {
  enum Signal : int { kVoltage = 0, kCurrent = 1, kAngle = 2, kSpeed = 3 };
  double delay[4] = {0, 0, 0, 0};    // s, by Signal
  double lowpass[4] = {0, 0, 0, 0};  // s, time constant of a first-order filter, by Signal
  double i_lsb = 0;                  // A, ADC step beyond that of the sensors; 0: none
  double i_limit = 0;                // A, the ADC's range; 0: unlimited
  double missing = 0, stale = 0;     // share of rows that are lost; that repeat the row before
  double held = 0;                   // share of rows whose currents alone repeat
};

class EffectPhysics {
 public:
  virtual ~EffectPhysics() = default;
  // The equations and readings it enters: bits of Acts.
  virtual int acts_on() const = 0;
  // Its contribution at the point; zero for an effect with a memory (model/effects/memory.hpp).
  virtual Contribution at(const OperatingPoint& point) const = 0;
  // Its addition to i_around.
  virtual Vec2 current_around(const OperatingPoint&) const { return Vec2::Zero(); }

  // True if a switched inverter itself makes the average of at(): the facts then replace at().
  virtual bool describe_legs(LegFacts&) const { return false; }
  // True if the plant has to carry a second mass.
  virtual bool describe_shaft(ShaftFacts&) const { return false; }
  // True if the plant has to change the samples.
  virtual bool describe_sampling(SamplingFacts&) const { return false; }
  // True if its torque acts behind the shaft (if there is one), as the declared load does.
  virtual bool behind_shaft() const { return false; }
  // True if its voltage drop follows the angle smoothly between samples; currents do not.
  virtual bool drops_by_angle() const { return false; }
};

}  // namespace twinrate
