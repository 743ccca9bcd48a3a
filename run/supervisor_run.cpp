// The course of a launched run: bus, start, watch, stop.
#include <fmt/format.h>

#include <algorithm>

#include "core/make_event.hpp"
#include "core/realtime_setup.hpp"
#include "core/seconds_since.hpp"
#include "core/signals_io.hpp"
#include "run/supervisor.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

}  // namespace

void Supervisor::publish_event(Reason reason, const std::string& text,
                               std::optional<Role> waited_for) {
  const status_t& plant = latest_[static_cast<int>(Role::kPlant)];
  bus_->publish(make_event({.role = Role::kSupervisor,
                            .reason = reason,
                            .k = plant.seq,
                            .t_ns = plant.t_ns,
                            .text = text,
                            .waited_for = waited_for}));
}

// A datagram may be lost, and a link may be cut: asks until each has said that it ends, for a second.
void Supervisor::stop_own_processes() {
  const auto ends = [this](Role role) {
    return role == Role::kReference ||
           latest_[static_cast<int>(role)].state >= static_cast<int>(ProcessState::kDone);
  };
  const auto begun = Clock::now();
  while (!options_.without.empty() && seconds_since(begun) < 1) {
    request(RequestKind::kStop);
    const auto sent = Clock::now();
    while (seconds_since(sent) < 0.05) bus_->handle(20);
    if (std::all_of(options_.without.begin(), options_.without.end(), ends)) return;
  }
}

void Supervisor::stop_in_order() {
  progress_.end();
  if (!facts_.ended.empty() || stop_signalled())
    publish_event(stop_signalled() ? Reason::kStopRequested
                  : listens()      ? Reason::kProcessLost
                  : frozen_        ? Reason::kProcessFrozen
                                   : Reason::kProcessDied,
                  facts_.ended.empty() ? "stopped by Ctrl-C" : facts_.ended);
  set_.stop({Role::kPlant}, 3);
  set_.stop({Role::kBridge}, 3);
  for (int i = 0; i < 20 && bus_->handle(1); ++i) {
  }
  set_.stop({Role::kEstimator, Role::kController, Role::kGain, Role::kMonitor}, 3);
  set_.stop({Role::kLogger}, 10);
  if (!options_.own.empty()) request(RequestKind::kStop);
  stop_own_processes();
  for (const Child& child : set_.children())
    if (child.exit_code != 0)
      end_early(fmt::format("{} ended with {}", child.program, describe_end(child)));
  // The last heartbeats hold the final counts. Under a flood the bus is never silent.
  constexpr double kLastWords_s = 0.3;
  const auto ended = Clock::now();
  while (seconds_since(ended) < kLastWords_s && bus_->handle(5)) {
  }
}

// As the processes ask for it themselves: what is refused here is refused there.
std::string Supervisor::set_up_realtime() const {
  const RealtimeParameters& wanted = options_.realtime;
  const bool as_started = has_realtime_policy();
  const std::string own = take_fifo(fifo_priority(wanted, Role::kSupervisor));
  std::string text = wanted.priority == 0 && !as_started ? "normal scheduler"
                     : own.empty() ? "normal scheduler, because SCHED_FIFO is refused"
                     : as_started  ? own
                                   : fmt::format("SCHED_FIFO {}", wanted.priority);
  text += !wanted.lock_memory ? ", memory not locked"
          : can_lock_memory() ? ", memory locked"
                              : ", memory not locked, because that is refused";
  text += pinned_ ? ", pinned" : ", not pinned";
  if (wanted.spin_us > 0) text += fmt::format(", spinning {:g} us", wanted.spin_us);
  return text;
}

void Supervisor::open_bus() {
  bus_ = std::make_unique<Bus>(BusOptions{.url = options_.url,
                                          .channel_suffix = options_.channel_suffix,
                                          .session = session_,
                                          .split_ports = options_.bus.split_ports,
                                          .filter = options_.bus.filter,
                                          .role = Role::kSupervisor,
                                          .token_file = token_->path(),
                                          .authenticate = options_.bus.authenticate});
  bus_->subscribe<status_t>([this](const status_t& s) { note_status(s); });
  bus_->subscribe<event_t>([this](const event_t& e) { note_failure(e); });
  if (!options_.without.empty())
    bus_->subscribe<reply_t>([this](const reply_t& r) { links_.take(r, host_now_ns()); });
  if (progress_.visible()) {
    bus_->subscribe<truth_t>([this](const truth_t& w) { pair(w.seq, truths_, from_wire(w)); },
                             Wake::kQuiet);
    bus_->subscribe<estimate_t>(
        [this](const estimate_t& w) { pair(w.seq, estimates_, from_wire(w)); }, Wake::kQuiet);
  }
}

// Of the last heartbeats.
void Supervisor::count_messages() {
  for (LinkFigures& link : facts_.links) link.missed = latest_[static_cast<int>(link.role)].gaps;
  for (const auto& [role, status] : latest_) {
    facts_.repeats += status.repeats;
    facts_.refused += status.refused;
    facts_.late_gains += status.late_gains;
    facts_.late_commands += status.late_commands;
    facts_.deadline_misses += status.deadline_misses;
  }
}

RunFacts Supervisor::run() {
  const SessionFile session_file(
      {options_.directory, options_.url, options_.channel_suffix, session_});
  const bool waits = !options_.without.empty() || !options_.own.empty();
  if (!waits) start_children();
  open_bus();
  start_own();
  if (waits && wait_for_own_processes()) start_children();
  facts_.on_bus = true;
  facts_.how = fmt::format("launch, {}, {} processes{}",
                           options_.wall                      ? "lock-step at the wall clock"
                           : options_.pace == Pace::kLockstep ? "lock-step"
                                                              : "realtime",
                           set_.children().size() + options_.without.size(),
                           set_.child(Role::kBridge) ? ", emulated drive" : "");
  const bool as_started = has_realtime_policy();
  if (options_.pace == Pace::kRealtime) facts_.scheduling = set_up_realtime();
  auto begun = Clock::now();
  if (!set_.children().empty() && wait_until_ready()) {
    begun = Clock::now();
    watch();
  }
  facts_.wall_s = seconds_since(begun);
  if (!as_started && has_realtime_policy()) leave_fifo();  // the report computes for seconds
  facts_.tags_checked = options_.bus.authenticate;
  facts_.realtime = options_.pace == Pace::kRealtime;
  facts_.links = links_.figures(host_now_ns());
  stop_in_order();
  count_messages();
  token_.reset();
  return facts_;
}

}  // namespace twinrate
