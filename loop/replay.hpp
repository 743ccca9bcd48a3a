// A recorded log played back to the processes on a bus.
//
//   lock-step   MEASUREMENT(k) goes out, ESTIMATE(k) comes back and is compared with the logged one
//               bit for bit
//   paced       the recorded bytes go out at their time stamps, session included
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/run_log.hpp"
#include "loop/lcm_replay.hpp"

namespace twinrate {

struct LockstepResult {
  std::int64_t played = 0;
  std::int64_t equal = 0, different = 0;  // of the estimates that the log holds
  std::int64_t first_difference_k = -1;
  std::int64_t unanswered_k = -1;  // the tick at which no estimate came: the replay ended there
  std::int64_t repeats = 0;        // measurements sent again
  double wall_s = 0;
};

struct PacedResult {
  std::int64_t played = 0;
  double wall_s = 0;
};

// True where an estimator of any session beats its heart on the bus within half a second.
bool estimator_heard(const BusAddress& address);

// Ends early after SIGINT.
LockstepResult replay_lockstep(const RunLog& log, const BusParameters& parameters,
                               const BusAddress& address, std::int64_t session);

// `channels` without the suffix that the log's channels have; `speed` times as fast as recorded.
// Throws BadInput where a part of the log cannot be read.
PacedResult replay_paced(const std::string& log, const std::string& logged_suffix,
                         const std::vector<std::string>& channels, const BusAddress& address,
                         double speed);

}  // namespace twinrate
