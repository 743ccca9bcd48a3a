// From records to a named set of effects.
#pragma once
#include "core/drive_config.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

struct TraceSettings {
  double holdout = 0.25;       // share of the time that does not train
  Say say;                     // progress, one line each; may be empty
  std::function<bool()> stop;  // asked at every step: true ends the trace; may be empty
};

// Of each row: whether the rotor moves there, so that friction is what the speed says.
std::vector<char> moving_rows(const Record& record);
// Of each row: whether it stands in a block that does not train.
std::vector<char> held_out_rows(const Record& record, double share, int n_p);

// Where it is stopped after at least one round of the selection the result holds what was found
// until then; before that TraceStopped is thrown. `held_out`: of each row of the record; empty:
// blocks by settings.holdout.
TraceResult trace_record(const Record& record, const DriveConfig& drive, const Health& health,
                         const TraceSettings& settings, std::vector<char> held_out = {});

}  // namespace twinrate
