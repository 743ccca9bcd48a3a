// --fault KIND=VALUE of twinrate-emulator.
#pragma once
#include <string>
#include <vector>

#include "emulator/device.hpp"
#include "emulator/faulty_line.hpp"

namespace twinrate {

struct FaultOptions {
  LineFaults up, down;
  DeviceFaults device;
  double drift_ppm = 0;
};

// Throws BadInput: unknown kind, no number, out of range.
FaultOptions parse_faults(const std::vector<std::string>& faults);
// Every kind with its value, for --help.
std::string fault_help();

}  // namespace twinrate
