// Measured files that are no full drive log: sets without time (flux map, inverter curve, holding
// currents) and logs of angle and i_q. What the columns are decides who traces them.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "core/drive_config.hpp"
#include "import/map.hpp"
#include "trace/hooks.hpp"
#include "trace/result.hpp"

namespace twinrate {

struct MeasuredFiles {
  std::vector<std::string> data, held_out;
  std::vector<std::string> maps;  // each file takes the first whose columns it has
  std::optional<double> share;    // of the data that does not train, where no file is held out
  bool repair = false;
};

// The map of `maps` that fits the header of `path`; none where there are no maps. A single map is
// taken as it is, so that the reader says what does not fit. Throws BadInput where none of several
// does.
std::optional<ImportMap> map_for(const std::string& path, const std::vector<std::string>& maps);

// Empty where the files are full drive logs, or such but for i_d. Throws BadInput; Stopped
// (core/percent_line.hpp) where `hooks` stop it while reading, TraceStopped before anything was
// found.
std::optional<TraceResult> trace_measured_files(const MeasuredFiles& files,
                                                const DriveConfig& drive,
                                                const TraceHooks& hooks = {});

}  // namespace twinrate
