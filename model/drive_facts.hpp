// Data of the drive that an effect may need besides the operating point.
#pragma once
#include "model/machine.hpp"

namespace twinrate {

struct DriveFacts {
  MachineParameters machine;
  double v_dc = 0;   // V, nominal
  double f_pwm = 0;  // Hz
  double T_s = 0;    // s, for which the controller holds a voltage; 0: not known
};

}  // namespace twinrate
