// Files of measured data as the tracer reads them: a drive log CSV, a foreign file through a map,
// or a recorded LCM log.
#pragma once
#include <functional>
#include <string>

#include "tools/import/drive_rows.hpp"
#include "trace/health.hpp"

namespace twinrate {

// Columns of a CSV, moved out of `rows`.
RawLog raw_log(DriveRows rows);
// An LCM log (or run directory): measurements, the voltage moved to the row it begins at, and the
// external load of the config that the log holds. Throws BadInput.
RawLog raw_log_of_run(const std::string& path);
bool is_run_log(const std::string& path);

}  // namespace twinrate
