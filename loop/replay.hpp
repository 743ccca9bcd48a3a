// Replay of a recorded log to the processes on a bus.
//
//   lock-step   sends MEASUREMENT(k), receives ESTIMATE(k) and compares it bit for bit with the
//               logged one
//   paced       sends the recorded bytes at their time stamps, session included
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/run_log.hpp"
#include "loop/lcm_replay.hpp"

namespace twinrate {

struct LockstepResult {
  std::int64_t played = 0;
  std::int64_t equal = 0, different = 0;  // compared with the logged estimates
  std::int64_t first_difference_k = -1;
  std::int64_t unanswered_k = -1;  // tick without an estimate, at which the replay ended
  std::int64_t repeats = 0;        // measurements sent again
  double wall_s = 0;
};

struct PacedResult {
  std::int64_t played = 0;
  double wall_s = 0;
};

// True if an estimator of any session sends a heartbeat within 0.5 s.
bool estimator_on_bus(const BusAddress& address);

// Effects that were added or removed while the log was written are added or removed at the same
// ticks. Ends early after SIGINT.
LockstepResult replay_lockstep(const RunLog& log, const BusParameters& parameters,
                               const BusAddress& address, std::int64_t session);

// `channels`: names without the log's suffix. `speed`: ratio to the recorded speed. Throws BadInput
// at damage of the log.
PacedResult replay_paced(const std::string& log, const std::string& logged_suffix,
                         const std::vector<std::string>& channels, const BusAddress& address,
                         double speed, OnDamage on_damage);

}  // namespace twinrate
