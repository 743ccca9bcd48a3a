// Results of sets without time and of logs of angle and current, in the common form of a trace.
#pragma once
#include "trace/considered.hpp"
#include "trace/position_log.hpp"
#include "trace/result.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {

TraceResult static_result(const StaticSet& set, const StaticTrace& trace, StaticKind kind);

struct PositionSettings {
  // s, over which a change of speed is predicted; 0: five sampling intervals.
  double horizon = 0;
  TraceHooks hooks = {};
  Considered considered = {};
};

// Traces logs of theta_m and i_q, with holding-current maps among them. The constant K_t/J comes
// from the dynamic logs that train and is the same in the model before and after. On a held-out log
// only the mean is fitted. The error is that of the change of speed over the horizon if a dynamic
// log is held out (or, if none is held out, trains), else that of the holding current. If stopped
// after something was found, returns that, judged as far as possible; if stopped earlier, throws
// TraceStopped.
TraceResult trace_positions(const std::vector<PositionLog>& logs, const DriveFacts& facts,
                            const PositionSettings& settings = {});

// Chooses the hold-out if no file is held out: the last `share` in time of a log in which the
// current moves the rotor; short pieces spread over a map or a log in which it holds the rotor.
std::vector<PositionLog> hold_out(const std::vector<PositionLog>& logs, double share,
                                  const MachineParameters& machine);

}  // namespace twinrate
