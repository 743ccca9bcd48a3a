// Results of sets without time and of logs of angle and current, in the form of every trace.
#pragma once
#include "trace/considered.hpp"
#include "trace/position_log.hpp"
#include "trace/result.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {

TraceResult static_result(const StaticSet& set, const StaticTrace& trace, StaticKind kind);

struct PositionSettings {
  // s over which a change of speed is predicted; 0: five sampling intervals.
  double horizon = 0;
  TraceHooks hooks = {};
  Considered considered = {};
};

// Logs of theta_m and i_q, holding-current maps among them. The constants K_t/J come from the
// dynamic logs that train and are the same in the model before and after; nothing is fitted on a
// held-out log but its mean. The error is that of the change of speed over the horizon where a
// dynamic log is held out (or, where nothing is, trains), else that of the current that holds.
// Stopped after something was found: that, judged as far as it was judged; before: throws
// TraceStopped.
TraceResult trace_positions(const std::vector<PositionLog>& logs, const DriveFacts& facts,
                            const PositionSettings& settings = {});

// Where no file is held out: of a log in which the current moves the rotor the last `share` in time;
// of one in which it holds the rotor, and of a map, short pieces spread over all of it.
std::vector<PositionLog> hold_out(const std::vector<PositionLog>& logs, double share,
                                  const MachineParameters& machine);

}  // namespace twinrate
