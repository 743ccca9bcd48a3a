// The channels of a RunLog as one table: one row a tick with the messages of that tick.
//
// Pointers refer to the log and are valid as long as it exists; null: no message at that tick. Of a
// repeated tick the first message is used.
#pragma once
#include <vector>

#include "core/run_log.hpp"

namespace twinrate {

struct TickRow {
  std::int64_t k = -1;
  double t_s = 0;
  const Measurement* measurement = nullptr;
  const Truth* truth = nullptr;
  const Estimate* estimate = nullptr;
  const Command* command = nullptr;
  const GainRecord* gain = nullptr;  // used by the fast loop at this tick (Estimate::gain_seq)
};

// Every tick of MEASUREMENT, TRUTH, ESTIMATE or COMMAND, in order.
std::vector<TickRow> tick_rows(const RunLog& log);

}  // namespace twinrate
