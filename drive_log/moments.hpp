// Finds the time of a load step between two blocks of a long log.
//
// The blocks show that the load differs between the end of one and the start of the next. The gap
// between them is bisected: the mean torque residual of a stretch in its middle, without the step
// in the model, decides the half. In the last interval the time of the step is the least-squares
// one,
//   t = argmax_t sum over rows from t on of (e - T/2) sign(T)
// with e the torque residual without the step and T the step.
#pragma once
#include "drive_log/drive_logs.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Corrects time_s of each load_step of `result` in or beside a gap between blocks. Throws BadInput.
void find_moments(const DriveLogs& logs, const DriveConfig& drive, TraceResult& result);

}  // namespace twinrate
