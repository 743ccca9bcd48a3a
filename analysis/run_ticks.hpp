// The ticks of a run for its summary and its page: from a log in memory, or row by row during the
// run.
#pragma once
#include "analysis/summary_builder.hpp"

namespace twinrate {

struct RunTicks {
  std::vector<TickRow> rows;  // in order of time
  RunOutline outline;         // of them, and of the messages of each channel

  // Time of the first tick with a measurement.
  std::optional<double> measured_from_s() const;
};

RunTicks run_ticks(const RunLog& log);

}  // namespace twinrate
