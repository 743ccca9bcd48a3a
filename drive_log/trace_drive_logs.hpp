// Traces full drive logs.
#pragma once
#include "drive_log/drive_logs.hpp"
#include "trace/tracer.hpp"

namespace twinrate {

// For each row of logs.record: 1 if held out. The rows of held-out files; without such files the
// hold-out blocks of the tracer, `share` of the rows.
std::vector<char> held_out_rows(const DriveLogs& logs, double share, int n_p);

// Traces logs.record and finds the times of load steps between its blocks. The result has the paths
// of the files and the notes of their reading. Throws BadInput; TraceStopped as trace_record().
TraceResult trace_drive_logs(const DriveLogs& logs, const std::vector<char>& held_out,
                             const DriveConfig& drive, const TraceSettings& settings);

}  // namespace twinrate
