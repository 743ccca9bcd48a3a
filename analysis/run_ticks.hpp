// The ticks of a run as its summary and its page need them: of a log in memory, or row by row as the
// run goes.
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
