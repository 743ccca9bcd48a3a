#include "core/process.hpp"

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <utility>

#include "core/make_event.hpp"
#include "core/paths.hpp"
#include "core/realtime_setup.hpp"
#include "core/seconds_since.hpp"

namespace twinrate {
namespace {

volatile std::sig_atomic_t stop_flag = 0;
void note_stop(int) {
  stop_flag = 1;
}

constexpr auto kBeatPeriod = std::chrono::milliseconds(100);
constexpr double kStartPatience_s = 10;  // before the first tick: the peers may still be starting
constexpr double kPatienceStep_s = 0.2;
// Realtime: a set whose supervisor is silent for so long ends. The plant is off by then.
constexpr double kOrphanAfter_s = 1;
constexpr std::int64_t kMaxJump = 50;   // ticks; over more the filter does not predict
constexpr double kLoggerLater_s = 0.3;  // the last events of the others are in the log

// For a plant that has ended the run: nobody waits for it.
constexpr auto kForGood = std::chrono::steady_clock::time_point::max();

BusOptions bus_options(const ProcessInfo& info, const ProcessOptions& o, const BusParameters& p,
                       const DriveConfig& d, const RateHistory& rates,
                       const BackgroundRate& gain_rate, double spin_us) {
  return {.url = o.url,
          .channel_suffix = o.channel_suffix,
          .session = o.session,
          .follow = o.follow,
          .drop_rate = p.drop_rate,
          .split_ports = p.split_ports,
          .filter = p.filter,
          .role = info.role,
          .gains_between =
              [&rates, &gain_rate](std::int64_t first, std::int64_t last) {
                return std::max<std::int64_t>(1, rates.gains_between(first, last, gain_rate));
              },
          .ticks = o.session != 0 && !o.follow ? d.steps() : INT64_MAX,
          .max_jump = o.pace == Pace::kRealtime && o.session != 0 ? kMaxJump : 0,
          .history = static_cast<std::size_t>(p.window_ticks) + kKeptBeyondWindow,
          .drain_every_ms = info.drain_every_ms,
          .spin_us = spin_us,
          .later_cpu = o.pace == Pace::kLockstep ? o.helper_cpu : -1,
          .token_file = o.token_file,
          .shared_memory = o.shared_memory,
          .authenticate = p.authenticate};
}

}  // namespace

void catch_stop_signals() {
  stop_flag = 0;
  struct sigaction action {};
  action.sa_handler = note_stop;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  struct sigaction hangup {};  // of the terminal; nohup ignores it
  if (sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler != SIG_IGN)
    sigaction(SIGHUP, &action, nullptr);
}
bool stop_signalled() {
  return stop_flag != 0;
}

void pin_to_cpu(int cpu) {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<std::size_t>(cpu), &set);
  if (sched_setaffinity(0, sizeof set, &set) != 0)
    fmt::print(stderr, "cannot pin to CPU {}: running unpinned\n", cpu);
}

Process::Process(const ProcessInfo& info, ProcessOptions options)
    : info_(info),
      options_(std::move(options)),
      config_(Config::load(options_.config, options_.overrides)),
      bus_parameters_(config_.read<BusParameters>()),
      steered_(config_),
      rates_(steered_.rates()),
      gain_rate_(drive().background_rate()) {
  if (drive().locks_first()) gain_rate_.from = BackgroundRate::kNotYet;
  if (options_.cpu >= 0) pin_to_cpu(options_.cpu);  // before the bus has sockets
  bus_ = std::make_unique<Bus>(
      bus_options(info_, options_, bus_parameters_, drive(), rates_, gain_rate_, spin_us()));
  status_.seq = -1;
  status_.role = static_cast<std::int32_t>(info_.role);
  status_.state = static_cast<std::int32_t>(ProcessState::kStarting);
  bus_->subscribe<request_t>([this](const request_t& request) { handle_request(request); });
  bus_->subscribe<status_t>([this](const status_t& other) {
    if (other.role == static_cast<int>(Role::kSupervisor)) return hear_supervisor(other);
    if (other.role != status_.role) {
      if (other.state < static_cast<int>(ProcessState::kDone))
        heard_[other.role] = Clock::now();
      else if (other.role == static_cast<int>(Role::kPlant) &&
               other.state == static_cast<int>(ProcessState::kDone))
        heard_[other.role] = kForGood;
      else
        heard_.erase(other.role);
    }
    compare_config(other);
  });
  if (options_.pace == Pace::kRealtime)
    bus_->subscribe<event_t>([this](const event_t& event) { expect_restarted(event); });
  bus_->on_twin([this](const status_t& twin) { leave_to(twin); });
  if (info_.role == Role::kPlant) bus_->on_untagged_request([this] { note_refused(untagged_); });
  if (info_.role == Role::kPlant || info_.role == Role::kLogger)
    bus_->on_second_sender([this](const Bus::SecondSender& second) { note_second(second); });
  last_progress_ = Clock::now();
}

double Process::spin_us() {
  const bool spins = info_.role == Role::kEstimator || info_.role == Role::kController;
  if (options_.pace != Pace::kRealtime || !spins) return 0;
  return config_.read<RealtimeParameters>().spin_us;
}

void Process::set_up_realtime() {
  if (options_.pace != Pace::kRealtime) return;
  const auto wanted = config_.read<RealtimeParameters>();
  if (wanted.lock_memory && info_.role != Role::kMonitor) lock_memory();
  take_fifo(fifo_priority(wanted, info_.role));
}

// A restarted process has another socket.
void Process::expect_restarted(const event_t& event) {
  const auto reason = static_cast<Reason>(event.reason);
  const bool restarts = reason == Reason::kProcessLost || reason == Reason::kLogLost;
  if (restarts && event.waited_for >= 0 && bus_->is_from(Role::kSupervisor))
    bus_->forget_sender(static_cast<Role>(event.waited_for));
}

// A supervisor counts its heartbeats: a recorded heartbeat keeps no drive alive.
void Process::hear_supervisor(const status_t& beat) {
  if (beat.steps <= supervisor_beats_ && bus_->checks_tags()) return bus_->refuse();
  supervisor_beats_ = beat.steps;
  supervisor_heard_ = Clock::now();
}

// A role has one instance in a session. Of two instances the one with less progress ends, and only
// at its start; later no message ends it.
void Process::leave_to(const status_t& twin) {
  constexpr double kStart_s = 0.5;
  const bool starts = status_.steps == 0 || seconds_since(ready_) < kStart_s;
  if (starts && twin.steps > status_.steps && twin.config_hash == status_.config_hash &&
      twin.state == static_cast<std::int32_t>(ProcessState::kRunning))
    throw BadInput(fmt::format("--session {}: a {} of this session runs already", options_.session,
                               role_name(twin.role)));
}

// An event for each of the first kSecondsNamed sockets; all messages are counted. The logger names
// those of the channels that the plant does not hear.
void Process::note_second(const Bus::SecondSender& second) {
  constexpr std::size_t kSecondsNamed = 16;
  const bool plant_hears = second.channel == Channel::kCommand || second.channel == Channel::kAck ||
                           second.channel == Channel::kStatus || second.channel == Channel::kReply;
  if (info_.role == Role::kLogger && plant_hears) return;
  if (seconds_.size() >= kSecondsNamed || !seconds_.insert(second.socket).second) return;
  const std::string channel = info(second.channel).name;
  event(Reason::kSecondSender, status_.seq,
        fmt::format(
            "a second sender of {} is refused: {}",
            second.role < 0 ? channel : fmt::format("{} as {}", channel, role_name(second.role)),
            text_of(second.socket)));
}

// The first one is named at once, those of the next heartbeat period together at its end.
void Process::note_refused(std::int64_t& count) {
  ++count;
  if (Clock::now() - refused_named_ >= kBeatPeriod) log_refused();
}

// Of one process, though all refuse them.
void Process::log_refused() {
  const auto name = [this](const char* what, std::int64_t& count) {
    if (count == 0) return;
    refused_named_ = Clock::now();
    event(Reason::kRequestRefused, status_.seq,
          fmt::format("refused requests {}: {}", what, std::exchange(count, 0)));
  };
  name("without a valid tag", untagged_);
  name("that were heard before", recorded_);
  name("that only the plant may send", foreign_);
  name("from a sender without control", not_holder_);
}

// The five processes of a session must have been started with one config. Each hears the others
// before its first tick; later messages with another config hash are ignored.
void Process::compare_config(const status_t& other) {
  const bool of_the_set =
      other.role >= static_cast<int>(Role::kPlant) && other.role <= static_cast<int>(Role::kLogger);
  if (!bus_->bound() || finished_ || !of_the_set || other.config_hash == 0 ||
      status_.config_hash == 0 || other.config_hash == status_.config_hash)
    return;
  if (status_.steps > 0) return bus_->refuse();
  fail(Reason::kConfigMismatch, status_.seq,
       fmt::format("{} and {} have different drive files", kRoleNames[status_.role],
                   kRoleNames[other.role]));
}

void Process::ready() {
  set_up_realtime();
  if (!lockstep() && new_model_) builder_ = std::make_unique<Worker>();
  status_.config_hash = config_.fingerprint();
  status_.state = static_cast<std::int32_t>(ProcessState::kReady);
  ready_ = last_progress_ = Clock::now();
  beat();
}

void Process::beat() {
  const BusCounters& counters = bus_->counters();
  status_.t_ns = status_.seq >= 0 ? drive().t_ns(status_.seq) : 0;
  status_.gaps = counters.gaps;
  status_.refused = counters.refused;
  status_.undecodable = counters.undecodable;
  bus_->publish(status_);
  last_beat_ = Clock::now();
}

void Process::progress(std::int64_t k) {
  status_.seq = k;
  ++status_.steps;
  if (status_.state == static_cast<std::int32_t>(ProcessState::kReady))
    status_.state = static_cast<std::int32_t>(ProcessState::kRunning);
  last_progress_ = Clock::now();
}

void Process::check_patience() {
  if (!bus_->bound() || options_.wait_for_start) return;
  const double waited = seconds_since(last_progress_), patience = bus_parameters_.peer_timeout_s;
  if (waited <= (status_.steps > 0 ? patience : std::max(patience, kStartPatience_s))) return;
  const auto plant = heard_.find(static_cast<int>(Role::kPlant));
  if (plant != heard_.end() && plant->second == kForGood) {  // the run is whole
    if (options_.token_file.empty()) finish();  // only the supervisor of a launched set ends it
    return;
  }
  const Waiting waiting = waiting_for_ ? waiting_for_() : Waiting{"a message"};
  if (waited <= patience + kPatienceStep_s * static_cast<int>(waiting.patience)) return;
  fail(Reason::kPeerTimeout, status_.seq,
       fmt::format("{} waited {:.1f} s for {}", kRoleNames[status_.role], waited, waiting.text()),
       waiting.from);
}

std::optional<double> Process::supervisor_silent_s() const {
  if (!supervisor_heard_) return {};
  return seconds_since(*supervisor_heard_);
}

void Process::clock_stood(std::int64_t ns) {
  if (supervisor_heard_)
    supervisor_heard_ = std::min(*supervisor_heard_ + std::chrono::nanoseconds(ns), Clock::now());
}

// A stopped supervisor can neither watch the set nor end it.
void Process::check_supervisor() {
  const double patience_s = kOrphanAfter_s + (info_.role == Role::kLogger ? kLoggerLater_s : 0);
  if (lockstep() || !bus_->bound() || supervisor_silent_s().value_or(0) <= patience_s) return;
  fail(Reason::kSupervisorLost, status_.seq,
       fmt::format("the supervisor was silent for {:.1f} s: {} ends", *supervisor_silent_s(),
                   info_.program));
}

bool Process::turn(double timeout_ms) {
  bus_->handle(timeout_ms);
  if (arbiter_) arbiter_->turn();
  take_built();
  if (Clock::now() - last_beat_ >= kBeatPeriod) {
    // A process that was stopped itself has received nothing meanwhile.
    if (supervisor_heard_ && seconds_since(last_beat_) > kOrphanAfter_s / 2)
      supervisor_heard_ = Clock::now();
    beat();
    log_refused();
    if (!finished_) check_patience();
    if (!finished_) check_supervisor();
  }
  return !stopping();
}

void Process::run(const std::function<void()>& on_quiet) {
  auto last_activity = Clock::now();
  std::int64_t steps_then = status_.steps;
  while (turn(repeat_after_ms())) {
    if (status_.steps != steps_then) {
      steps_then = status_.steps;
      last_activity = Clock::now();
    } else if (on_quiet && seconds_since(last_activity) * 1000 >= repeat_after_ms()) {
      on_quiet();
      last_activity = Clock::now();
    }
  }
}

void Process::event(Reason reason, std::int64_t k, const std::string& text,
                    std::optional<Role> waited_for) {
  bus_->publish(make_event({.role = info_.role,
                            .reason = reason,
                            .k = k,
                            .t_ns = k >= 0 ? drive().t_ns(k) : 0,
                            .text = text,
                            .waited_for = waited_for}));
}

void Process::finish(ProcessState state) {
  if (exit_code() != 0) return;  // a signal afterwards does not make it well
  finished_ = true;
  status_.state = static_cast<std::int32_t>(state);
  beat();
}

void Process::fail(Reason reason, std::int64_t k, const std::string& text,
                   std::optional<Role> waited_for) {
  fmt::print(stderr, "{}: {}\n", info_.program, text);
  event(reason, k, text, waited_for);
  finish(ProcessState::kFailed);
}

bool Process::stopping() const {
  return finished_ || stop_signalled();
}

}  // namespace twinrate
