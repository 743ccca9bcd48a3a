// Traces measured files other than full drive logs: sets without time (flux map, inverter curve,
// holding currents) and logs of angle and i_q. The columns decide the kind of file.
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "core/drive_config.hpp"
#include "import/map.hpp"
#include "trace/considered.hpp"
#include "trace/hooks.hpp"
#include "trace/result.hpp"

namespace twinrate {

struct MeasuredFiles {
  std::vector<std::string> data, held_out;
  std::vector<std::string> maps;  // a file uses the first map whose columns it has
  std::optional<double> share;    // held-out share of the rows, if no file is held out
  bool repair = false;
  Considered considered = {};
};

// The first of `maps` that fits the header of `path`; empty without maps. A single map is used
// unchecked: the reader then reports the column that does not fit. Throws BadInput if none of
// several maps fits.
std::optional<ImportMap> map_for(const std::string& path, const std::vector<std::string>& maps);

// Empty if the files are full drive logs, with or without i_d. Throws BadInput; Stopped
// (core/percent_line.hpp) if `hooks` stop the reading; TraceStopped if they stop the trace before
// its first result.
std::optional<TraceResult> trace_measured_files(const MeasuredFiles& files,
                                                const DriveConfig& drive,
                                                const TraceHooks& hooks = {});

}  // namespace twinrate
