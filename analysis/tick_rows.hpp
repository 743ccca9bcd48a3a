// A RunLog read across its channels: one row per tick, with the message of each at t_k.
//
// Pointers are into the log and live as long as it does; null where the log has nothing at that
// tick. A tick that a log holds twice counts once.
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
  const GainRecord* gain = nullptr;  // the one the fast loop used at this tick (Estimate::gain_seq)
};

// In tick order: every tick that MEASUREMENT, TRUTH, ESTIMATE or COMMAND mentions.
std::vector<TickRow> tick_rows(const RunLog& log);

}  // namespace twinrate
