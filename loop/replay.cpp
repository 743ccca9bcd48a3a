#include "loop/replay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "core/process.hpp"
#include "core/seconds_since.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

// Finds the logged estimate of a tick. Ticks must not decrease from call to call.
class LoggedEstimates {
 public:
  explicit LoggedEstimates(const std::vector<Estimate>& estimates) : estimates_(estimates) {}
  const Estimate* at(std::int64_t k) {
    while (next_ < estimates_.size() && estimates_[next_].k < k) ++next_;
    return next_ < estimates_.size() && estimates_[next_].k == k ? &estimates_[next_] : nullptr;
  }

 private:
  const std::vector<Estimate>& estimates_;
  std::size_t next_ = 0;
};

// In pieces: a pause of the log can be long, and Ctrl-C ends it.
void sleep_until(Clock::time_point begun, double offset_s) {
  constexpr double kPiece_s = 0.1;
  for (double left_s = 1; left_s > 0 && !stop_signalled();) {
    left_s = offset_s - seconds_since(begun);
    if (left_s > 0)
      std::this_thread::sleep_for(std::chrono::duration<double>(std::min(left_s, kPiece_s)));
  }
}

}  // namespace

bool estimator_on_bus(const BusAddress& address) {
  bool found = false;
  Bus bus({.url = address.url,
           .channel_suffix = address.channel_suffix,
           .follow = true,
           .role = Role::kReplay});
  bus.subscribe<status_t>([&](const status_t& s) {
    found = found || (s.role == static_cast<int>(Role::kEstimator) &&
                      s.state < static_cast<int>(ProcessState::kDone));
  });
  const auto begun = Clock::now();
  while (!found && seconds_since(begun) < 0.5) bus.handle(20);
  return found;
}

LockstepResult replay_lockstep(const RunLog& log, const BusParameters& parameters,
                               const BusAddress& address, std::int64_t session) {
  LockstepResult result;
  LcmReplay replay(parameters, address, session);
  for (const ModelChange& change : model_changes_in(log)) replay.change_model(change);
  LoggedEstimates logged(log.estimate);
  const auto begun = Clock::now();
  for (const Measurement& m : log.measurement) {
    const std::optional<Estimate> answer = replay.play(m);
    if (stop_signalled()) break;
    if (!answer) {
      result.unanswered_k = m.k;
      break;
    }
    ++result.played;
    const Estimate* expected = logged.at(m.k);
    if (!expected) continue;
    if (same_bits(*expected, *answer)) {
      ++result.equal;
    } else if (result.different++ == 0) {
      result.first_difference_k = m.k;
    }
  }
  result.repeats = replay.repeats();
  result.wall_s = seconds_since(begun);
  return result;
}

PacedResult replay_paced(const std::string& log, const std::string& logged_suffix,
                         const std::vector<std::string>& channels, const BusAddress& address,
                         double speed, OnDamage on_damage) {
  // Fails on a machine without multicast before the first message is sent.
  const Bus probe({.url = address.url, .role = Role::kReplay});
  lcm::LCM out(probe.url());
  const auto begun = Clock::now();
  PacedResult result;
  std::int64_t first_us = -1, t_us = -1;
  EventLog events(log, on_damage, logged_suffix);
  if (!out.good()) throw BadInput(fmt::format("{}: cannot be played", log));
  while (const lcm::LogEvent* event = events.next()) {
    if (stop_signalled()) break;
    if (!events.channel()) continue;
    const std::string name = info(*events.channel()).name;
    if (std::find(channels.begin(), channels.end(), name) == channels.end()) continue;
    if (first_us < 0) first_us = t_us = event->timestamp;
    // A damaged log may have any time stamp, although its message is whole.
    if (event->timestamp >= t_us && event->timestamp - t_us < kLongestGap_us)
      t_us = event->timestamp;
    sleep_until(begun, static_cast<double>(t_us - first_us) * 1e-6 / speed);
    if (stop_signalled()) break;
    out.publish(name + address.channel_suffix, event->data, static_cast<unsigned>(event->datalen));
    ++result.played;
  }
  result.wall_s = seconds_since(begun);
  return result;
}

}  // namespace twinrate
