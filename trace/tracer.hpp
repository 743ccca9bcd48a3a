// From records to a named set of effects.
#pragma once
#include "core/drive_config.hpp"
#include "trace/health.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"
#include "trace/split.hpp"

namespace twinrate {

// Rows [first, end) of the record are those of one file.
struct SourceRows {
  std::string path;
  std::size_t first = 0, end = 0;
  bool held_out = false;
  double time_offset_s = 0;  // time in the record less time in the file
};

struct TraceSettings {
  double holdout = 0.25;          // share of the time that does not train
  Say say;                        // progress, one line each; may be empty
  std::function<bool()> stop;     // called at every step: true ends the trace; may be empty
  std::vector<SourceRows> files;  // of the record; empty: one
  Considered considered;          // kinds that the model may lack
  // If judging rows are given: fits the passed effects once more, with these rows included. If the
  // judging rows are blocks of the record, this is always done.
  bool fit_judging_rows = false;
};

// If stopped after at least one round of the selection, the result holds the effects found so far;
// before that TraceStopped is thrown. `held_out`: of each row of the record, whether it judges;
// empty: blocks by settings.holdout.
TraceResult trace_record(const Record& record, const DriveConfig& drive, const Health& health,
                         const TraceSettings& settings, std::vector<char> held_out = {});

}  // namespace twinrate
