// A slip of the user that explains a log as well as an effect does: currents in another unit or
// order, a parameter in another unit. The check of log and drive file reports a slip that the log
// shows. A log at one speed and current may show no scale, and then an effect fits in place of the
// slip.
#pragma once
#include <string>

#include "trace/scale_factors.hpp"

namespace twinrate {

struct Slip {
  std::string text;                      // empty: no slip fits
  bool voltage = false, torque = false;  // equations that it explains
  bool frame = false;                    // it explains them by a vector that turns in rotor axes
};
Slip slip_that_fits(const Record& record, const DriveFacts& facts);

}  // namespace twinrate
