// Reads the logs for --verify: each log from its start, as many rows as the tracer can hold.
#pragma once
#include <vector>

#include "drive_log/drive_logs.hpp"
#include "verify/verify.hpp"

namespace twinrate {

// `held_out`: for each row of logs.record. The rows between the blocks of a long log are held out
// too. If files are held out, the training files are omitted. Throws BadInput.
std::vector<VerifyLog> verify_logs(const LogRequest& asked, const DriveConfig& drive,
                                   const DriveLogs& logs, const std::vector<char>& held_out);

}  // namespace twinrate
