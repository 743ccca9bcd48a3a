// Requests in a process: answered by it, or left to the plant, which arbitrates.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/process.hpp"
#include "core/seconds_since.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kRequestsRemembered = 1 << 16;
constexpr std::size_t kEffectsAnswered = 64;  // a sender repeats its last request only

std::string host_name() {
  std::array<char, 64> name{};
  gethostname(name.data(), name.size() - 1);
  return name.data();
}

void refuse(reply_t& reply, const std::string& why) {
  reply.accepted = 0;
  reply.text = why;
}

}  // namespace

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

// The phases of a request (core/arbiter.hpp) come from the plant, or the bridge in its place.
bool Process::is_of_the_plant() const {
  return bus_->is_from(Role::kPlant) || bus_->is_from(Role::kBridge);
}

Arbiter::Asker Process::asker() const {
  return {.socket = bus_->checks_tags() ? bus_->sender() : 0,
          .is_monitor = bus_->is_from(Role::kMonitor)};
}

void Process::handle_request(const request_t& request) {
  const auto refuse = [this](std::int64_t& count) {
    bus_->refuse();
    if (info_.role == Role::kPlant) note_refused(count);
  };
  const auto kind = static_cast<RequestKind>(request.kind);
  const bool phase =
      kind == RequestKind::kPrepare || kind == RequestKind::kApplyAt || kind == RequestKind::kDrop;
  if (phase && !is_of_the_plant()) return refuse(foreign_);
  if (is_recorded(request)) return refuse(recorded_);
  reply_t reply = reply_to(request);
  if (answer(request, reply)) bus_->publish(reply);
}

reply_t Process::reply_to(const request_t& request) const {
  reply_t reply{};
  reply.seq = request.seq;
  reply.t_ns = status_.t_ns;
  reply.role = status_.role;
  reply.accepted = 1;
  reply.applied_seq = status_.seq;
  return reply;
}

bool Process::answer(const request_t& request, reply_t& reply) {
  switch (static_cast<RequestKind>(request.kind)) {
    case RequestKind::kStart:
      return start();
    case RequestKind::kStop:
      if (!finished_) finish();
      return true;
    case RequestKind::kEmergencyStop:
      return emergency_stop(reply);
    case RequestKind::kReset:
      return answer_reset(request, reply);
    case RequestKind::kSteer:
    case RequestKind::kTakeControl:
    case RequestKind::kGiveControl:
      if (arbiter_) arbiter_->take(request, asker());
      return false;
    case RequestKind::kPrepare:
    case RequestKind::kApplyAt:
      return !arbiter_ && answer_arbiter(request, reply);
    case RequestKind::kDrop:
      if (prepared_ && prepared_->request.seq == request.seq) prepared_.reset();
      return false;
    case RequestKind::kAddEffect:
    case RequestKind::kRemoveEffect:
      return answer_model_change(request, reply);
    case RequestKind::kClock:
      reply.t_ns = host_now_ns();
      reply.text = host_name();
      return true;
    case RequestKind::kAddProposed:
      if (!add_proposed_) return false;
      if (!add_proposed_(request.text)) refuse(reply, "no effect is proposed");
      return true;
  }
  refuse(reply, fmt::format("unknown request kind {}", request.kind));
  return true;
}

bool Process::start() {
  if (info_.role != Role::kPlant) return false;
  if (options_.wait_for_start) status_.state = static_cast<std::int32_t>(ProcessState::kRunning);
  options_.wait_for_start = false;
  return true;
}

bool Process::emergency_stop(reply_t& reply) {
  if (!emergency_stop_) return false;
  emergency_stop_();
  reply.applied_seq = status_.seq + 1;
  reply.t_ns = drive().t_ns(reply.applied_seq);
  event(Reason::kEmergencyStop, status_.seq, "emergency stop: zero voltage from the next tick on");
  return true;
}

bool Process::answer_reset(const request_t& request, reply_t& reply) {
  if (arbiter_) arbiter_->take(request, asker());
  if (arbiter_ || !reset_ || (must_be_arbitrated() && info_.role != Role::kBridge)) return false;
  reset(request, reply);
  return true;
}

bool Process::answer_model_change(const request_t& request, reply_t& reply) {
  if (arbiter_) arbiter_->take(request, asker());
  if (arbiter_ || must_be_arbitrated() || !new_model_) return false;
  change_model(request, reply);
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
  constexpr double kStart_s = 0.5;   // five heartbeats: who was not heard by then is not in the set
  const bool starts = seconds_since(ready_) < kStart_s;
  std::set<int> roles;
  for (const Role role : {Role::kEstimator, Role::kController, Role::kGain, Role::kLogger}) {
    const auto heard = heard_.find(static_cast<int>(role));
    const bool is_there =
        heard != heard_.end() && (lockstep() || seconds_since(heard->second) < kSilent_s);
    if (is_there)
      roles.insert(static_cast<int>(role));
    else if (starts || role == Role::kEstimator || role == Role::kController)
      throw BadInput(fmt::format("no heartbeat of the {}", role_name(static_cast<int>(role))));
  }
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
      .prepare = [this](const request_t& request) { prepared_ = prepared(request, status_.seq); },
      .apply =
          [this](const request_t& request) {
            apply_prepared(static_cast<std::int64_t>(request.value));
          },
      .ask = [this](request_t request) { bus_->publish(std::move(request)); },
      .answer =
          [this](reply_t reply) {
            reply.t_ns = drive().t_ns(std::max<std::int64_t>(0, reply.applied_seq));
            reply.role = status_.role;
            bus_->publish(std::move(reply));
          },
      .event = [this](Reason reason, std::int64_t k,
                      const std::string& text) { event(reason, k, text); },
      .released = std::move(released),
      .refused = [this] { note_refused(not_holder_); }};
  arbiter_.emplace(std::move(host));
  bus_->subscribe<reply_t>([this](const reply_t& reply) { arbiter_->take(reply); });
}

// The planned changes of the drive file come first; extended_ is the last of them.
void Process::on_new_model(NewModel build) {
  new_model_ = std::move(build);
  for (const std::int64_t k : drive().model_changes()) {
    extended_ = config_.known_at(k);
    new_model_ (*extended_)(k);
    planned_until_k_ = k;
  }
}

Config Process::changed_model(const request_t& request, std::int64_t last_k) const {
  if (last_k < planned_until_k_)
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

Process::Prepared Process::prepared(const request_t& request, std::int64_t last_k) {
  Prepared result{.request = request};
  if (request.kind == static_cast<std::int32_t>(RequestKind::kSteer)) {
    const std::int64_t k = std::max<std::int64_t>(1, last_k + 1);
    SteeredDrive wanted = steered_;
    wanted.apply(request.text, k);
    if (follower_.check) follower_.check(wanted, k);
  } else if (request.kind == static_cast<std::int32_t>(RequestKind::kReset)) {
    if (const std::string why = reset_ ? reset_(kNoTick) : ""; !why.empty()) throw BadInput(why);
  } else if (new_model_) {
    result.changed = changed_model(request, last_k);
    result.use = new_model_(*result.changed);
  }
  return result;
}

Process::Prepared Process::prepared_or_refused(const request_t& request, std::int64_t last_k) {
  try {
    return prepared(request, last_k);
  } catch (const std::exception& refused) {
    return {.request = request, .refusal = refused.what()};
  }
}

// In realtime no tick waits for reading an effect, or for building a filter or a table. The builder
// reads the state that a request changes, so nothing is applied while it is busy.
const Process::Prepared* Process::prepare(const request_t& request) {
  if (!builder_ || request.kind == static_cast<std::int32_t>(RequestKind::kReset)) {
    prepared_ = prepared_or_refused(request, status_.seq);
    return &*prepared_;
  }
  if (prepared_ && prepared_->request.seq == request.seq) return &*prepared_;
  if (!builder_->is_busy())
    builder_->start([this, request, last_k = status_.seq] {
      spent_.reset();
      built_ = prepared_or_refused(request, last_k);
    });
  return nullptr;
}

void Process::take_built() {
  if (!builder_ || !builder_->ended()) return;
  prepared_ = std::exchange(built_, {});
  bus_->publish(answer_of(*prepared_));
}

void Process::apply_prepared(std::int64_t k) {
  const request_t& request = prepared_->request;
  if (request.kind == static_cast<std::int32_t>(RequestKind::kSteer)) {
    steered_.apply(request.text, k);
    steered_.forget_before(std::min(k, status_.seq));
    rates_ = steered_.rates();
    if (follower_.follow) follower_.follow(steered_);
  } else if (request.kind == static_cast<std::int32_t>(RequestKind::kReset)) {
    if (reset_) reset_(k);
  } else if (prepared_->changed) {
    prepared_->use(k);
    std::swap(extended_, prepared_->changed);
    const bool add = request.kind == static_cast<std::int32_t>(RequestKind::kAddEffect);
    event(add ? Reason::kEffectAdded : Reason::kEffectRemoved, k,
          fmt::format("{}: from tick {} on with{} {}", info_.program, k, add ? "" : "out",
                      request.text));
  }
  if (applied_action_ && request.kind == static_cast<std::int32_t>(RequestKind::kSteer))
    applied_action_(request.text, k);
  applied_request_ = request.seq;
  applied_k_ = k;
  spent_ = std::exchange(prepared_, {});  // the builder has the time to delete a model
}

reply_t Process::answer_of(const Prepared& prepared) const {
  reply_t reply = reply_to(prepared.request);
  reply.applied_seq = -1;
  reply.accepted = prepared.refusal.empty() ? 1 : 0;
  reply.text = prepared.refusal;
  return reply;
}

bool Process::answer_arbiter(const request_t& request, reply_t& reply) {
  const bool known = request.seq == applied_request_;
  if (request.kind == static_cast<std::int32_t>(RequestKind::kPrepare)) {
    if (known || info_.role == Role::kMonitor || info_.role == Role::kReplay) return false;
    request_t asked = request;
    asked.kind = static_cast<std::int32_t>(static_cast<std::int64_t>(request.value));
    const Prepared* prepared = prepare(asked);
    if (prepared) reply = answer_of(*prepared);
    return prepared;
  }
  if (!known) {
    const bool can_apply = prepared_ && prepared_->request.seq == request.seq &&
                           prepared_->refusal.empty() && !(builder_ && builder_->is_busy());
    if (!can_apply) return false;
    apply_prepared(static_cast<std::int64_t>(request.value));
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
    Config changed = changed_model(request, status_.seq);
    new_model_(changed)(reply.applied_seq);
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

}  // namespace twinrate
