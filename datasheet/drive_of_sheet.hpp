// A drive file from data-sheet values: the machine, and rates and a first run that suit it.
#pragma once
#include <string>
#include <vector>

#include "datasheet/machine_of_sheet.hpp"

namespace twinrate {

struct DriveOfSheet {
  std::string toml;  // the drive file, with every conversion as a comment
  std::vector<std::string> conversions, assumed, doubts;  // of MachineOfSheet
  std::vector<std::string> derived;   // time constants, speeds and rates, one line each
  std::vector<std::string> warnings;  // of check_by_trial()
};

// Throws the BadInput of machine_of_sheet(), and BadInput if the drive file would not run.
DriveOfSheet drive_of_sheet(const std::string& name, const Sheet& sheet);

}  // namespace twinrate
