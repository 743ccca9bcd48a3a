// From an unknown motor on its inverter to a drive file: the experiments in order, the comparison
// with a data sheet, and the output.
#pragma once
#include <string>
#include <vector>

#include "core/config.hpp"
#include "identify/experiment.hpp"
#include "identify/found.hpp"

namespace twinrate {

// The test current and the speed limit of an identification: the ratings of the drive file. Throws
// BadInput.
IdentifyLimits limits_of(const DriveConfig& drive);

// Runs every experiment: standstill.hpp, spin.hpp. Uses only the rig. Throws RunFailed.
Identified identify(Rig& rig, const IdentifyLimits& limits, const IdentifyHooks& hooks);

// One parameter beside its value on the sheet.
struct SheetRow {
  std::string key, unit;
  Found found;
  double sheet = 0;
  std::string verdict;  // "agrees", or the ratio, with the slips that have this factor
};
// `sheet`: the [machine] table of a drive file.
std::vector<SheetRow> compare(const Identified& found, const MachineParameters& sheet);

// The drive file with the identified machine. The effects of the source file are replaced by those
// found. Throws BadInput.
std::string identified_toml(const Config& drive, const Identified& found);
std::string identified_json(const Identified& found, const std::vector<SheetRow>& rows);
std::string identified_text(const Identified& found, const std::vector<SheetRow>& rows);

}  // namespace twinrate
