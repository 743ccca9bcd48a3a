// Lock-step replay of measurements to estimator and gain processes: MEASUREMENT(k) is repeated
// until ESTIMATE(k) arrives.
#pragma once
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/bus.hpp"
#include "core/bus_parameters.hpp"
#include "core/process_set.hpp"
#include "core/run_log.hpp"
#include "model/signals.hpp"

namespace twinrate {

// A bus, and the suffix of every channel name on it.
struct BusAddress {
  std::string url, channel_suffix;
};

// Estimator and gain processes of one config, started for a replay.
class OwnEstimator {
 public:
  // Throws std::runtime_error if no temporary directory can be created.
  OwnEstimator(const std::string& config_toml, const BusAddress& address, std::int64_t session);
  ~OwnEstimator();

 private:
  std::string directory_;
  ProcessSet set_;
};

// Effects that were added to the running model of a log, or removed from it, in their order.
struct ModelChange {
  std::int64_t k = 0;  // first tick with it
  bool add = true;
  std::string effects;  // [[effect]] tables
};
std::vector<ModelChange> model_changes_in(const RunLog& log);

class LcmReplay {
 public:
  LcmReplay(const BusParameters& parameters, const BusAddress& address, std::int64_t session);
  // Before the first tick: estimator and gain change their model at the tick of the log. Throws
  // BadInput if one of them refuses or does not answer.
  void change_model(const ModelChange& change);
  // Empty after bus.peer_timeout_s without an answer, or after a stop signal.
  std::optional<Estimate> play(const Measurement& m);
  std::int64_t repeats() const { return repeats_; }

 private:
  BusParameters parameters_;
  std::int64_t session_;
  Bus bus_;
  std::int64_t waiting_k_ = -1, repeats_ = 0;
  std::optional<Estimate> answer_;
  std::int64_t asked_ = 0;  // the request that waits for answers
  std::set<int> agreed_;    // roles
  std::string refused_;
};

// Equal bit for bit, NaN included.
bool same_bits(const Estimate& a, const Estimate& b);

}  // namespace twinrate
