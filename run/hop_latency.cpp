#include "run/hop_latency.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/decode.hpp"
#include "core/event_log.hpp"

namespace twinrate {
namespace {

struct HostTimes {
  std::int64_t k = -1;
  std::int64_t measurement_ns = 0, estimate_ns = 0, command_ns = 0;
};

// The newest ticks: the messages of a tick arrive close together.
class Ticks {
 public:
  // Null where the message is none of the three.
  HostTimes* take(std::optional<Channel> channel, const lcm::LogEvent& event) {
    if (channel == Channel::kMeasurement)
      return &take<measurement_t>(event, &HostTimes::measurement_ns);
    if (channel == Channel::kEstimate) return &take<estimate_t>(event, &HostTimes::estimate_ns);
    if (channel == Channel::kCommand) return &take<command_t>(event, &HostTimes::command_ns);
    return nullptr;
  }

 private:
  template <class Message>
  HostTimes& take(const lcm::LogEvent& event, std::int64_t HostTimes::*time) {
    Message message{};
    if (!decode(message, event.data, static_cast<std::size_t>(event.datalen)) || message.seq < 0)
      return nothing_ = {};
    HostTimes& tick = ring_[static_cast<std::size_t>(message.seq) % ring_.size()];
    if (tick.k != message.seq) tick = {.k = message.seq};
    tick.*time = message.host_ns;
    return tick;
  }

  std::vector<HostTimes> ring_ = std::vector<HostTimes>(8192);
  HostTimes nothing_;
};

// Percentiles in constant memory: counts in bins whose width is 1/64 of an octave, 1.1 %.
class Histogram {
 public:
  void add(double us) {
    const double bin = kPerOctave * std::log2(std::max(us, kLeast_us) / kLeast_us);
    ++counts_[std::min(counts_.size() - 1, static_cast<std::size_t>(bin))];
    max_ = std::max(max_, us);
    ++count_;
  }
  std::int64_t count() const { return count_; }
  Percentiles percentiles() const {
    if (count_ == 0) return {};
    return {.p50 = at(0.5), .p99 = at(0.99), .p99_9 = at(0.999), .max = max_};
  }

 private:
  static constexpr double kPerOctave = 64, kLeast_us = 0.1;
  // Upper end of the bin of the smallest sample that is not below this share of them.
  double at(double share) const {
    const double rank = std::max(1.0, std::ceil(share * static_cast<double>(count_)));
    double below = 0;
    for (std::size_t i = 0; i < counts_.size(); ++i)
      if ((below += static_cast<double>(counts_[i])) >= rank)
        return std::min(max_, kLeast_us * std::exp2(static_cast<double>(i + 1) / kPerOctave));
    return max_;
  }
  std::vector<std::int64_t> counts_ = std::vector<std::int64_t>(2048);  // up to 7 min
  std::int64_t count_ = 0;
  double max_ = 0;
};

double us(std::int64_t from_ns, std::int64_t to_ns) {
  return 1e-3 * static_cast<double>(to_ns - from_ns);
}

}  // namespace

Percentiles percentiles_of(std::vector<double>& samples) {
  if (samples.empty()) return {};
  std::sort(samples.begin(), samples.end());
  const auto at = [&](double share) {
    const double rank = std::ceil(share * static_cast<double>(samples.size()));
    return samples[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
  };
  return {.p50 = at(0.5), .p99 = at(0.99), .p99_9 = at(0.999), .max = samples.back()};
}

HopLatencies hop_latencies(const std::string& log, const ClockOffsets& clocks) {
  Ticks ticks;
  Histogram to_estimate, to_command, round;
  EventLog events(log, OnDamage::kSkip);
  while (const lcm::LogEvent* event = events.next()) {
    HostTimes* tick = ticks.take(events.channel(), *event);
    if (!tick || tick->measurement_ns == 0 || tick->estimate_ns == 0 || tick->command_ns == 0)
      continue;
    const std::int64_t measured_ns = tick->measurement_ns - clocks.plant_ns,
                       estimated_ns = tick->estimate_ns - clocks.estimator_ns,
                       commanded_ns = tick->command_ns - clocks.controller_ns;
    to_estimate.add(us(measured_ns, estimated_ns));
    to_command.add(us(estimated_ns, commanded_ns));
    round.add(us(measured_ns, commanded_ns));
    *tick = {};  // counted
  }
  return {.rounds = round.count(),
          .to_estimate_us = to_estimate.percentiles(),
          .to_command_us = to_command.percentiles(),
          .round_us = round.percentiles()};
}

std::optional<SlowAnswer> slowest_answer(const std::string& log, std::int64_t k,
                                         const ClockOffsets& clocks) {
  constexpr std::int64_t kTicks = 100;
  std::map<std::int64_t, HostTimes> last;  // all on one clock
  Ticks ticks;
  EventLog events(log, OnDamage::kSkip);
  while (const lcm::LogEvent* event = events.next())
    if (const HostTimes* tick = ticks.take(events.channel(), *event);
        tick && tick->k > k - kTicks && tick->k <= k)
      last[tick->k] = *tick;
  std::int64_t end_ns = 0;
  for (auto& [seq, tick] : last) {
    if (tick.measurement_ns) tick.measurement_ns -= clocks.plant_ns;
    if (tick.estimate_ns) tick.estimate_ns -= clocks.estimator_ns;
    if (tick.command_ns) tick.command_ns -= clocks.controller_ns;
    end_ns = std::max(end_ns, tick.measurement_ns);
  }
  std::optional<SlowAnswer> slowest;
  const auto take = [&](Role role, std::int64_t seq, std::int64_t from_ns, std::int64_t to_ns) {
    if (from_ns == 0) return;  // nothing to answer
    const double ms = 1e-3 * us(from_ns, to_ns == 0 ? end_ns : to_ns);
    if (!slowest || ms > slowest->ms) slowest = {role, seq, ms, to_ns != 0};
  };
  for (const auto& [seq, tick] : last) {
    take(Role::kEstimator, seq, tick.measurement_ns, tick.estimate_ns);
    take(Role::kController, seq, tick.estimate_ns, tick.command_ns);
  }
  return slowest;
}

std::string text_of(const SlowAnswer& slow) {
  const bool estimator = slow.role == Role::kEstimator;
  const std::string asked = fmt::format("{}({})", estimator ? "MEASUREMENT" : "ESTIMATE", slow.k);
  const char* who = estimator ? "the estimator" : "the controller";
  return slow.came ? fmt::format("{} answered {} after {:.1f} ms", who, asked, slow.ms)
                   : fmt::format("{} did not answer {} within {:.1f} ms", who, asked, slow.ms);
}

}  // namespace twinrate
