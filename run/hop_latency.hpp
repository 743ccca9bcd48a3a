// How long the messages of a tick took from process to process, by the host times in the log.
//
//   to_estimate   host_ns of ESTIMATE(k) - host_ns of MEASUREMENT(k)
//   to_command    host_ns of COMMAND(k) - host_ns of ESTIMATE(k)
//   round         host_ns of COMMAND(k) - host_ns of MEASUREMENT(k)
//
// Each contains the transport and the work of the process that answers. The transport of COMMAND to
// the plant is not in them: the plant publishes nothing in answer.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

struct Percentiles {
  double p50 = 0, p99 = 0, p99_9 = 0, max = 0;
};
// The smallest sample that is not below the given share of them. `samples` is reordered.
Percentiles percentiles_of(std::vector<double>& samples);

struct HopLatencies {
  std::int64_t rounds = 0;  // ticks of which all three messages have a host time
  Percentiles to_estimate_us, to_command_us, round_us;
};
// Offsets of the hosts' clocks: with them all times are on one clock.
struct ClockOffsets {
  std::int64_t plant_ns = 0, estimator_ns = 0, controller_ns = 0;
};
// Of a run directory or a log, in constant memory: the percentiles are within 1.1 %. Damage of the
// log is skipped; without host times rounds = 0.
HopLatencies hop_latencies(const std::string& log, const ClockOffsets& clocks = {});

// Which of estimator and controller kept a tick waiting longest, of the 100 ticks up to k. Empty without host times.
struct SlowAnswer {
  Role role = Role::kEstimator;
  std::int64_t k = 0;  // of the tick
  double ms = 0;       // without an answer: up to MEASUREMENT of the last tick
  bool came = true;
};
std::optional<SlowAnswer> slowest_answer(const std::string& log, std::int64_t k,
                                         const ClockOffsets& clocks = {});
std::string text_of(const SlowAnswer& slow);

}  // namespace twinrate
