// What --verify replays: each log from its beginning, as far as the tracer held rows of it.
#pragma once
#include <vector>

#include "drive_log/drive_logs.hpp"
#include "verify/verify.hpp"

namespace twinrate {

// `held_out`: of each row of logs.record; of a log that was traced in blocks the rows between them
// are held out, too. Files that train are left out where others do not. Throws BadInput.
std::vector<VerifyLog> verify_logs(const LogRequest& asked, const DriveConfig& drive,
                                   const DriveLogs& logs, const std::vector<char>& held_out);

}  // namespace twinrate
