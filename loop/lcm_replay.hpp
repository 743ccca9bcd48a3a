// Lock-step replay of measurements to estimator and gain processes: MEASUREMENT(k) is repeated
// until ESTIMATE(k) arrives.
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "core/bus.hpp"
#include "core/bus_parameters.hpp"
#include "core/process_set.hpp"
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

class LcmReplay {
 public:
  LcmReplay(const BusParameters& parameters, const BusAddress& address, std::int64_t session);
  // Empty after bus.peer_timeout_s without an answer, or after a stop signal.
  std::optional<Estimate> play(const Measurement& m);
  std::int64_t repeats() const { return repeats_; }

 private:
  BusParameters parameters_;
  std::int64_t session_;
  Bus bus_;
  std::int64_t waiting_k_ = -1, repeats_ = 0;
  std::optional<Estimate> answer_;
};

// Equal bit for bit, NaN included.
bool same_bits(const Estimate& a, const Estimate& b);

}  // namespace twinrate
