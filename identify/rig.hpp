// A motor on its inverter, as a measurement sees it: one tick, one voltage, one row of readings.
//
// Nothing here knows a parameter of the machine. The plant is simulated (simulated_rig.hpp), or a drive
// behind the bridge (bridge_rig.hpp).
#pragma once
#include <string>
#include <vector>

#include "model/frames.hpp"

namespace twinrate {

// What is known of an inverter and its sensors before anything is measured.
struct RigFacts {
  double T_s = 0;          // s, control period
  int delay_ticks = 1;     // a voltage acts this many ticks after it was asked for
  int encoder_counts = 0;  // a turn; 0: an exact angle
  double v_dc = 0;         // V, nominal
};

struct RigRow {
  Vec3 i_abc = Vec3::Zero();        // A, at t_k
  Vec2 u_alphabeta = Vec2::Zero();  // V, mean from t_{k-1} to t_k, as the inverter believes
  double theta_m = 0;               // rad, reading of the encoder at t_k, unwrapped
};

class Rig {
 public:
  virtual ~Rig() = default;
  virtual const RigFacts& facts() const = 0;
  // Asks for a voltage and returns the readings one tick later. `theta_e`: the frame in which the
  // voltage was made. Throws RunFailed where the drive switches off.
  virtual RigRow step(const Vec2& u_alphabeta_ref, double theta_e) = 0;
  // Nothing is asked for while the rows so far are evaluated: a drive that does not wait is switched off
  // until the next step(), whose row does not follow the one before.
  virtual void pause() {}
  // By how many ticks more than facts().delay_ticks a voltage has acted late, the worst so far.
  virtual int late_ticks() const { return 0; }
  // What the way to the motor left in the rows.
  virtual std::vector<std::string> notes() const { return {}; }
};

}  // namespace twinrate
