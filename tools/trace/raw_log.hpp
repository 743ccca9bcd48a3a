// Files of measured data as the tracer reads them: a drive log CSV, a foreign file through a map,
// or a recorded LCM log.
#pragma once
#include <functional>
#include <string>

#include "core/drive_config.hpp"
#include "tools/import/drive_rows.hpp"
#include "trace/health.hpp"

namespace twinrate {

// Columns of a CSV, moved out of `rows`.
RawLog raw_log(DriveRows rows);
// The rows of a CSV on the tick grid of a drive, as an estimator gets them. Throws BadInput.
std::vector<Measurement> measurements_of(const DriveRows& rows, const DriveConfig& drive);
// An LCM log (or run directory): measurements, the voltage moved to the row it begins at, and the
// external load of the config that the log holds. Throws BadInput.
RawLog raw_log_of_run(const std::string& path);
bool is_run_log(const std::string& path);

}  // namespace twinrate
