// A slip of the user that explains a log as well as an effect does: currents in another unit or order,
// a parameter in another unit. The check of log and drive file tells one where the log shows it. At one
// speed and current it may show no scale, and an effect fits in its place.
#pragma once
#include <string>

#include "trace/scale_factors.hpp"

namespace twinrate {

struct Slip {
  std::string text;                      // empty: none does
  bool voltage = false, torque = false;  // equations that it explains
  bool frame = false;                    // by a vector that turns in rotor axes
};
Slip slip_that_fits(const Record& record, const DriveFacts& facts);

}  // namespace twinrate
