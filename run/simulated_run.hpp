// Simulated run: the closed loop in one process with the log of the process set in lock-step, bit
// for bit.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "analysis/long_log.hpp"
#include "core/reason.hpp"
#include "loop/closed_loop.hpp"

namespace twinrate {

// Takes each tick of a run in the same process: the monitor (run/own_monitor.hpp).
class TickWatch {
 public:
  virtual ~TickWatch() = default;
  virtual void take(const TickRecord& tick) = 0;
  // At the end of the run. False if the disk is full.
  virtual bool write() const = 0;
};

// An event of the monitor, into the log.
using PublishEvent =
    std::function<void(Reason reason, const std::string& text, std::int64_t k, std::int64_t t_ns)>;
using MakeTickWatch = std::unique_ptr<TickWatch> (*)(Config& config, ClosedLoop& loop,
                                                     const std::string& directory,
                                                     const PublishEvent& publish);

// Runs to the end or to a stop signal and writes DIR/log.lcm, with monitor.enabled, which needs
// `make_monitor`, DIR/monitor.json. Returns the cause of an early end; "" for a complete run. Throws
// std::runtime_error if the log cannot be created.
// `make`: the filter, that of the drive file or an own one. `kept`, if not null, gets the log
// without its messages of ticks, and run_ticks() of them, of a run of up to kTicksShown ticks.
std::string run_simulated(Config& config, const std::string& directory, bool json,
                          const MakeFilter& make = make_filter,
                          std::optional<LongLog>* kept = nullptr,
                          MakeTickWatch make_monitor = nullptr);

}  // namespace twinrate
