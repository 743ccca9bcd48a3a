// Measurements played to estimator and gain processes in lock-step: MEASUREMENT(k) goes out again
// until ESTIMATE(k) is there.
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "core/bus.hpp"
#include "core/bus_parameters.hpp"
#include "core/process_set.hpp"
#include "model/signals.hpp"

namespace twinrate {

// Which bus, and what is appended to the name of every channel on it.
struct BusAddress {
  std::string url, channel_suffix;
};

// Estimator and gain of one config, on a bus where there are none.
class OwnEstimator {
 public:
  // Throws std::runtime_error where no temporary directory can be made.
  OwnEstimator(const std::string& config_toml, const BusAddress& address, std::int64_t session);
  ~OwnEstimator();

 private:
  std::string directory_;
  ProcessSet set_;
};

class LcmReplay {
 public:
  LcmReplay(const BusParameters& parameters, const BusAddress& address, std::int64_t session);
  // Empty where no estimator answered within bus.peer_timeout_s, or a stop signal came.
  std::optional<Estimate> play(const Measurement& m);
  std::int64_t repeats() const { return repeats_; }

 private:
  BusParameters parameters_;
  std::int64_t session_;
  Bus bus_;
  std::int64_t waiting_k_ = -1, repeats_ = 0;
  std::optional<Estimate> answer_;
};

// Bit for bit, NaN included.
bool same_bits(const Estimate& a, const Estimate& b);

}  // namespace twinrate
