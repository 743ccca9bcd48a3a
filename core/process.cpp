#include "core/process.hpp"

#include <fmt/format.h>
#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <array>
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
constexpr std::int64_t kMaxJump = 50;  // ticks; over more the filter does not predict
constexpr std::size_t kRequestsRemembered = 1 << 16;
constexpr std::size_t kEffectsAnswered = 64;  // a sender repeats its last request only
constexpr double kLoggerLater_s = 0.3;        // the last events of the others are in the log

// Of a plant that has ended the run: nobody waits for it.
constexpr auto kForGood = std::chrono::steady_clock::time_point::max();

std::string host_name() {
  std::array<char, 64> name{};
  gethostname(name.data(), name.size() - 1);
  return name.data();
}

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
  bus_->on_twin([this](const status_t& twin) { leave_to(twin); });
  if (info_.role == Role::kPlant) {
    bus_->on_untagged_request([this] { ++refused_requests_; });
    bus_->on_second_sender([this](const Bus::SecondSender& second) { note_second(second); });
  }
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

// A supervisor counts its heartbeats: one that was recorded keeps no drive alive.
void Process::hear_supervisor(const status_t& beat) {
  if (beat.steps <= supervisor_beats_ && bus_->checks_tags()) return bus_->refuse();
  supervisor_beats_ = beat.steps;
  supervisor_heard_ = Clock::now();
}

// A role has one instance in a session. The one that has done less leaves, and only at its start: later
// no message ends it.
void Process::leave_to(const status_t& twin) {
  constexpr double kStart_s = 0.5;
  const bool starts = status_.steps == 0 || seconds_since(ready_) < kStart_s;
  if (starts && twin.steps > status_.steps && twin.config_hash == status_.config_hash &&
      twin.state == static_cast<std::int32_t>(ProcessState::kRunning))
    throw BadInput(fmt::format("--session {}: a {} of this session runs already", options_.session,
                               role_name(twin.role)));
}

// An event for each of the first kSecondsNamed sockets; all messages are counted.
void Process::note_second(const Bus::SecondSender& second) {
  constexpr std::size_t kSecondsNamed = 16;
  if (seconds_.size() >= kSecondsNamed || !seconds_.insert(second.socket).second) return;
  const std::string channel = info(second.channel).name;
  second_texts_.push_back(fmt::format(
      "a second sender of {} is refused: {}",
      second.role < 0 ? channel : fmt::format("{} as {}", channel, role_name(second.role)),
      text_of(second.socket)));
}

// At most one event a heartbeat, however many there are; of one process, though all refuse them.
void Process::log_refused() {
  for (const std::string& text : std::exchange(second_texts_, {}))
    event(Reason::kSecondSender, status_.seq, text);
  if (refused_requests_ > 0)
    event(Reason::kRequestRefused, status_.seq,
          fmt::format("{} requests without a valid tag were refused",
                      std::exchange(refused_requests_, 0)));
  if (recorded_requests_ > 0)
    event(Reason::kRequestRefused, status_.seq,
          fmt::format("{} requests that had been heard before were refused",
                      std::exchange(recorded_requests_, 0)));
}

// A tag does not show that a request is new. Every sending has a later time of its sender, so one
// with the time of an earlier sending was recorded.
bool Process::is_recorded(const request_t& request) {
  if (!bus_->checks_tags() || request.kind == static_cast<std::int32_t>(RequestKind::kClock))
    return false;
  const RequestName name{request.kind, request.seq};
  const auto [heard, is_new] = requests_heard_.try_emplace(name, request.t_ns);
  if (!is_new) {
    if (request.t_ns <= heard->second) return true;
    heard->second = request.t_ns;
    return false;
  }
  requests_in_order_.push_back(name);
  if (requests_in_order_.size() > kRequestsRemembered) {
    requests_heard_.erase(requests_in_order_.front());
    requests_in_order_.pop_front();
  }
  return false;
}

void Process::handle_request(const request_t& request) {
  if (is_recorded(request)) {
    if (info_.role == Role::kPlant) ++recorded_requests_;
    return bus_->refuse();
  }
  reply_t reply{};
  reply.seq = request.seq;
  reply.t_ns = status_.t_ns;
  reply.role = status_.role;
  reply.accepted = 1;
  reply.applied_seq = status_.seq;
  if (answer(request, reply)) bus_->publish(reply);
}

bool Process::answer(const request_t& request, reply_t& reply) {
  const auto refuse = [&reply](const std::string& why) {
    reply.accepted = 0;
    reply.text = why;
  };
  switch (static_cast<RequestKind>(request.kind)) {
    case RequestKind::kStart:
      if (info_.role != Role::kPlant) return false;
      if (options_.wait_for_start)
        status_.state = static_cast<std::int32_t>(ProcessState::kRunning);
      options_.wait_for_start = false;
      return true;
    case RequestKind::kStop:
      if (!finished_) finish();
      return true;
    case RequestKind::kEmergencyStop:
      if (!emergency_stop_) return false;
      emergency_stop_();
      reply.applied_seq = status_.seq + 1;
      reply.t_ns = drive().t_ns(reply.applied_seq);
      event(Reason::kEmergencyStop, status_.seq,
            "emergency stop: zero voltage from the next tick on");
      return true;
    case RequestKind::kReset:
      if (arbiter_) arbiter_->take(request);
      if (arbiter_ || !reset_ || (must_be_arbitrated() && info_.role != Role::kBridge))
        return false;
      reset(request, reply);
      return true;
    case RequestKind::kSteer:
    case RequestKind::kTakeControl:
    case RequestKind::kGiveControl:
      if (arbiter_) arbiter_->take(request);
      return false;
    case RequestKind::kPrepare:
    case RequestKind::kApplyAt:
      return !arbiter_ && answer_arbiter(request, reply);
    case RequestKind::kDrop:
      if (prepared_ && prepared_->seq == request.seq) prepared_.reset();
      return false;
    case RequestKind::kAddEffect:
    case RequestKind::kRemoveEffect:
      if (arbiter_) arbiter_->take(request);
      if (arbiter_ || must_be_arbitrated() || !new_model_) return false;
      change_model(request, reply);
      return true;
    case RequestKind::kClock:
      reply.t_ns = host_now_ns();
      reply.text = host_name();
      return true;
    case RequestKind::kAddProposed:
      if (!add_proposed_) return false;
      if (!add_proposed_(request.text)) refuse("no effect is proposed");
      return true;
  }
  refuse(fmt::format("unknown request kind {}", request.kind));
  return true;
}

std::int64_t Process::tick_of(const request_t& request) const {
  const auto wanted = request.value > 0 && request.value < 9e15
                          ? static_cast<std::int64_t>(request.value)
                          : std::int64_t{0};
  return std::max(wanted, status_.seq + 1);
}

// A request that comes again gets the same answer: the drive may be on its way by then.
void Process::reset(const request_t& request, reply_t& reply) {
  if (reset_answer_ && reset_answer_->seq == request.seq) {
    reply = *reset_answer_;
    return;
  }
  reply.applied_seq = tick_of(request);
  reply.text = reset_(reply.applied_seq);
  if (!reply.text.empty()) {
    reply.accepted = 0;
    reply.applied_seq = -1;
  }
  reset_answer_ = reply;
}

// A launched set has a plant, a log player has none that answers.
bool Process::must_be_arbitrated() const {
  return bus_->bound() && !options_.follow;
}

std::set<int> Process::members() const {
  constexpr double kSilent_s = 0.5;  // realtime: a silent process cannot be waited for
  std::set<int> roles;
  for (const Role role : {Role::kEstimator, Role::kGain, Role::kController, Role::kLogger}) {
    const auto heard = heard_.find(static_cast<int>(role));
    if (heard != heard_.end() && (lockstep() || seconds_since(heard->second) < kSilent_s))
      roles.insert(static_cast<int>(role));
  }
  for (const Role role : {Role::kEstimator, Role::kController})
    if (!roles.count(static_cast<int>(role)))
      throw BadInput(fmt::format("no heartbeat of the {}", role_name(static_cast<int>(role))));
  return roles;
}

void Process::arbitrate(std::function<std::int64_t()> next_tick, std::function<void()> released) {
  Arbiter::Host host{
      .next_tick = std::move(next_tick),
      .ticks = drive().steps(),
      .margin_ticks = lockstep() ? 0 : std::llround(Arbiter::kMargin_s * drive().rates.f_s_Hz),
      .ahead_ticks = std::llround(Arbiter::kAhead_s * drive().rates.f_s_Hz),
      .hold_s = steered_.steering().hold_s,
      .members = [this] { return members(); },
      .prepare = [this](const request_t& request) { prepare(request); },
      .apply = [this](const request_t& request) { apply_prepared(request); },
      .ask = [this](request_t request) { bus_->publish(std::move(request)); },
      .answer =
          [this](reply_t reply) {
            reply.t_ns = drive().t_ns(std::max<std::int64_t>(0, reply.applied_seq));
            reply.role = status_.role;
            bus_->publish(std::move(reply));
          },
      .event = [this](Reason reason, std::int64_t k,
                      const std::string& text) { event(reason, k, text); },
      .released = std::move(released)};
  arbiter_.emplace(std::move(host));
  bus_->subscribe<reply_t>([this](const reply_t& reply) { arbiter_->take(reply); });
}

// What the drive file plans happens first; extended_ is what it plans last.
void Process::on_new_model(NewModel action, std::function<void(Config& extended)> check) {
  new_model_ = std::move(action);
  check_model_ = std::move(check);
  for (const std::int64_t k : drive().model_changes()) {
    extended_ = config_.known_at(k);
    new_model_(*extended_, k);
    planned_until_k_ = k;
  }
}

Config Process::changed_model(const request_t& request) const {
  if (status_.seq < planned_until_k_)
    throw BadInput(fmt::format("the drive file changes the model at tick {}: later allowed",
                               planned_until_k_));
  const Config& present = extended_ ? *extended_ : config_;
  return request.kind == static_cast<std::int32_t>(RequestKind::kAddEffect)
             ? present.with_effects(request.text, kEffectsSource)
             : present.without_effects(request.text, kEffectsSource, declared_effects());
}

// The effects of the model that no request added.
std::size_t Process::declared_effects() const {
  return planned_until_k_ < 0 ? config_.drive().effects.size()
                              : config_.known_at(planned_until_k_).drive().effects.size();
}

void Process::prepare(const request_t& request) {
  if (request.kind == static_cast<std::int32_t>(RequestKind::kSteer)) {
    const std::int64_t k = std::max<std::int64_t>(1, status_.seq + 1);
    SteeredDrive wanted = steered_;
    wanted.apply(request.text, k);
    if (follower_.check) follower_.check(wanted, k);
  } else if (request.kind == static_cast<std::int32_t>(RequestKind::kReset)) {
    if (const std::string why = reset_ ? reset_(kNoTick) : ""; !why.empty()) throw BadInput(why);
  } else if (new_model_) {
    Config changed = changed_model(request);
    if (check_model_) check_model_(changed);
  }
  prepared_ = request;
}

// `request`: as prepared, its value the tick.
void Process::apply_prepared(const request_t& request) {
  const auto k = static_cast<std::int64_t>(request.value);
  if (request.kind == static_cast<std::int32_t>(RequestKind::kSteer)) {
    steered_.apply(request.text, k);
    steered_.forget_before(std::min(k, status_.seq));
    rates_ = steered_.rates();
    if (follower_.follow) follower_.follow(steered_);
  } else if (request.kind == static_cast<std::int32_t>(RequestKind::kReset)) {
    if (reset_) reset_(k);
  } else if (new_model_) {
    Config changed = changed_model(request);
    new_model_(changed, k);
    extended_ = std::move(changed);
    const bool add = request.kind == static_cast<std::int32_t>(RequestKind::kAddEffect);
    event(add ? Reason::kEffectAdded : Reason::kEffectRemoved, k,
          fmt::format("{}: from tick {} on with{} {}", info_.program, k, add ? "" : "out",
                      request.text));
  }
  if (applied_action_ && request.kind == static_cast<std::int32_t>(RequestKind::kSteer))
    applied_action_(request.text, k);
  applied_request_ = request.seq;
  applied_k_ = k;
  prepared_.reset();
}

bool Process::answer_arbiter(const request_t& request, reply_t& reply) {
  const bool known = request.seq == applied_request_;
  if (request.kind == static_cast<std::int32_t>(RequestKind::kPrepare)) {
    reply.applied_seq = -1;
    if (known || info_.role == Role::kMonitor || info_.role == Role::kReplay) return false;
    request_t asked = request;
    asked.kind = static_cast<std::int32_t>(static_cast<std::int64_t>(request.value));
    try {
      prepare(asked);
    } catch (const BadInput& refused) {
      reply.accepted = 0;
      reply.text = refused.what();
    }
    return true;
  }
  if (!known) {
    if (!prepared_ || prepared_->seq != request.seq) return false;
    request_t due = *prepared_;
    due.value = request.value;
    apply_prepared(due);
  }
  reply.applied_seq = applied_k_;
  return true;
}

void Process::change_model(const request_t& asked, reply_t& reply) {
  request_t request = asked;
  request.text = without_holder(asked.text);
  const bool add = request.kind == static_cast<std::int32_t>(RequestKind::kAddEffect);
  const std::string identity = fmt::format("{} {} {}", request.seq, request.kind, request.text);
  for (const auto& [text, answer] : effects_answered_)
    if (text == identity) {
      reply = answer;
      return;
    }
  reply.applied_seq = tick_of(request);
  try {
    Config changed = changed_model(request);
    new_model_(changed, reply.applied_seq);
    extended_ = std::move(changed);
    event(add ? Reason::kEffectAdded : Reason::kEffectRemoved, reply.applied_seq,
          fmt::format("{}: from tick {} on with{} {}", info_.program, reply.applied_seq,
                      add ? "" : "out", request.text));
  } catch (const BadInput& refused) {
    reply.accepted = 0;
    reply.applied_seq = -1;
    reply.text = refused.what();
  }
  effects_answered_.emplace_back(identity, reply);
  if (effects_answered_.size() > kEffectsAnswered)
    effects_answered_.erase(effects_answered_.begin());
}

// The five processes of a session must have been started with one config. Each hears the others
// before its first tick; what another config hash says later is not believed.
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
    if (options_.token_file.empty()) finish();               // nobody ends a set started by hand
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
  if (Clock::now() - last_beat_ >= kBeatPeriod) {
    // A process that was stopped itself has heard nobody.
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
