// A motor on its inverter as the interface of a measurement: one tick, one voltage, one row of
// readings.
//
// The interface contains no parameter of the machine. The plant is simulated (simulated_rig.hpp),
// or a drive behind the bridge (bridge_rig.hpp).
#pragma once
#include <string>
#include <vector>

#include "model/frames.hpp"

namespace twinrate {

// Properties of an inverter and its sensors that are known before a measurement.
struct RigFacts {
  double T_s = 0;          // s, control period
  int delay_ticks = 1;     // from the request of a voltage to its effect
  int encoder_counts = 0;  // a turn; 0: an exact angle
  double v_dc = 0;         // V, nominal
};

struct RigRow {
  Vec3 i_abc = Vec3::Zero();        // A, at t_k
  Vec2 u_alphabeta = Vec2::Zero();  // V, mean from t_{k-1} to t_k, as reported by the inverter
  double theta_m = 0;               // rad, reading of the encoder at t_k, unwrapped
};

class Rig {
 public:
  virtual ~Rig() = default;
  virtual const RigFacts& facts() const = 0;
  // Asks for a voltage and returns the readings one tick later. `theta_e`: angle of the frame in
  // which the voltage was computed. Throws RunFailed if the drive switches off.
  virtual RigRow step(const Vec2& u_alphabeta_ref, double theta_e) = 0;
  // Pauses while the rows are evaluated: a drive in realtime is switched off until the next step(),
  // whose row does not follow the one before.
  virtual void pause() {}
  // Largest delay of a voltage so far beyond facts().delay_ticks, in ticks.
  virtual int late_ticks() const { return 0; }
  // Faults of the connection to the motor that the rows contain.
  virtual std::vector<std::string> notes() const { return {}; }
};

}  // namespace twinrate
