// When a load stepped, where the blocks of a long log do not hold the moment.
//
// The blocks say that the load differs between the end of one and the beginning of the next. The
// rows between are read block by block and the interval is halved each time by the mean torque that
// the traced model leaves there without the step; in what is left the moment t is where
//   sum over rows from t on of (e - T/2) sign(T)
// is largest, e the residual without the step and T the step: the least squares of a step.
#pragma once
#include "drive_log/drive_logs.hpp"
#include "trace/result.hpp"

namespace twinrate {

// Corrects time_s of each load_step of `result` that stands beside or in a gap between blocks.
// Throws BadInput.
void find_moments(const DriveLogs& logs, const DriveConfig& drive, TraceResult& result);

}  // namespace twinrate
