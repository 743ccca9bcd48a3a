// A machine drawn at random with parameters that fit one another as in a real motor: flux linkage
// from bus voltage and speed, torque from flux linkage and current, resistance from the share of
// copper loss, inductance from its voltage at rated load, inertia from the time to rated speed.
#pragma once
#include <string>

#include "bench/blind/draw.hpp"
#include "model/machine.hpp"

namespace twinrate::blind {

struct DrawnMachine {
  MachineParameters machine;
  double v_dc = 0;          // V
  double f_s = 0;           // Hz
  double t_accelerate = 0;  // s, from rest to rated speed at rated torque
  int encoder_counts = 0;   // 0: sine and cosine
  double angle_noise = 0;   // rad rms, of sine and cosine
  bool counts_declared = false;
  int current_sensors = 3;
  double i_lsb = 0, i_noise = 0, i_range = 0;                               // A
  double v_dc_noise = 0;                                                    // V rms
  double current_bandwidth = 0, speed_bandwidth = 0, filter_bandwidth = 0;  // Hz
  double i_max() const { return 1.75 * machine.i_rated; }
};

// 0.05 to 20 mH, 2 to 21 pole pairs, 1e-6 to 1e-1 kg m2, 12 to 560 V, 8 to 20 kHz.
DrawnMachine draw_machine(Draw& d);
// The drive file; `counts`: sensors.encoder_counts.
std::string drive_toml(const DrawnMachine& drawn, const std::string& name, int counts);

}  // namespace twinrate::blind
