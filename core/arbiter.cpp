#include "core/arbiter.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <utility>

#include "core/bus.hpp"
#include "core/config.hpp"
#include "core/seconds_since.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kAnswersKept = 64;

bool is(const request_t& request, RequestKind kind) {
  return request.kind == static_cast<std::int32_t>(kind);
}

std::string names_of(const std::set<int>& roles) {
  std::vector<std::string> names;
  names.reserve(roles.size());
  for (const int role : roles) names.emplace_back(role_name(role));
  return fmt::format("{}", fmt::join(names, ", "));
}

std::set<int> without(const std::set<int>& all, const std::set<int>& some) {
  std::set<int> rest;
  for (const int role : all)
    if (!some.count(role)) rest.insert(role);
  return rest;
}

}  // namespace

std::string without_holder(const std::string& text, std::string* holder) {
  if (!text.starts_with(Arbiter::kHolderLine)) return text;
  const auto end = std::min(text.find('\n'), text.size());
  const std::size_t begin = std::string(Arbiter::kHolderLine).size();
  if (holder) *holder = text.substr(begin, end - begin);
  return text.substr(std::min(end + 1, text.size()));
}

void Arbiter::take(const request_t& request, const Asker& asker) {
  if (is(request, RequestKind::kTakeControl) || is(request, RequestKind::kGiveControl))
    return control(request, asker);
  for (const reply_t& reply : answered_)
    if (reply.seq == request.seq) return host_.answer(reply);
  if (phase_ != Phase::kIdle) {
    if (request.seq == request_.seq && phase_ != Phase::kGathering) send_phase();
    return;  // it comes again
  }
  request_t wanted = request;
  request_ = request;
  if (const std::string why = not_allowed(wanted, asker); !why.empty()) {
    host_.refused();
    return refuse(why);
  }
  begin(std::move(wanted));
}

// Removes the holder's line from the request; "" if the request is allowed.
std::string Arbiter::not_allowed(request_t& request, const Asker& asker) const {
  std::string who;
  request.text = without_holder(request.text, &who);
  if (holder_.empty() || is_holder(who, asker)) return "";
  if (is(request, RequestKind::kSteer)
          ? request.text == "stop"
          : !is(request, RequestKind::kReset) && who == kMonitor && asker.is_monitor)
    return "";
  return holder_ + " has control";
}

bool Arbiter::is_holder(const std::string& name, const Asker& asker) const {
  return name == holder_ && (asker.socket == holder_socket_ || holder_socket_ == 0);
}

void Arbiter::control(const request_t& request, const Asker& asker) {
  reply_t reply{};
  reply.seq = request.seq;
  reply.applied_seq = -1;
  const bool take = is(request, RequestKind::kTakeControl), beat = take && request.value > 0;
  const bool is_his = is_holder(request.text, asker);
  if (beat && holder_ != request.text) {
    reply.text = "the control was lost";
  } else if (request.text.empty()) {
    reply.text = "a request for control needs the name of the holder";
  } else if (holder_.empty() ? !take : !is_his) {
    reply.text = holder_.empty() ? "nobody has control" : holder_ + " has control";
    if (!holder_.empty()) host_.refused();
  } else if (beat && request.t_ns <= holder_beat_ns_) {
    return;  // it was recorded
  } else {
    reply.accepted = 1;
    holder_beat_ns_ = request.t_ns;
    if (!take || !is_his)
      host_.event(Reason::kControlTaken, host_.next_tick(),
                  fmt::format("{} {} control", request.text, take ? "takes" : "gives up"));
    holder_ = take ? request.text : "";
    holder_socket_ = asker.socket;
    holder_heard_ = Clock::now();
    silent_ = false;
  }
  host_.answer(reply);
}

void Arbiter::begin(request_t request) {
  request_ = std::move(request);
  phase_ = Phase::kGathering;
  begun_ = Clock::now();
  gather();
}

// A set that starts has not heard every heartbeat: the request stays until it has.
void Arbiter::gather() {
  try {
    members_ = host_.members();
  } catch (const BadInput& silent) {
    if (seconds_since(begun_) > kPatience_s) refuse(silent.what());
    return;
  }
  const std::int64_t latest =
      std::min(host_.next_tick(), INT64_MAX - host_.ahead_ticks) + host_.ahead_ticks;
  if (request_.value > static_cast<double>(latest))
    return refuse(fmt::format("tick {:.0f}: up to tick {} allowed now, {:g} s ahead",
                              request_.value, latest, kAhead_s));
  try {
    host_.prepare(request_);
  } catch (const BadInput& refused) {
    return refuse(refused.what());
  }
  replied_.clear();
  refusal_.reset();
  begun_ = Clock::now();
  phase_ = Phase::kPreparing;
  if (members_.empty()) return begin_applying();
  send_phase();
}

void Arbiter::send_phase() {
  request_t message{};
  message.seq = request_.seq;
  const bool preparing = phase_ == Phase::kPreparing;
  message.kind =
      static_cast<std::int32_t>(preparing ? RequestKind::kPrepare : RequestKind::kApplyAt);
  message.value = preparing ? request_.kind : static_cast<double>(tick_);
  if (preparing) message.text = request_.text;
  sent_ = Clock::now();
  host_.ask(message);
}

void Arbiter::begin_applying() {
  const double wanted = request_.value;
  tick_ = std::max(host_.next_tick() + host_.margin_ticks, std::int64_t{1});
  if (wanted > static_cast<double>(tick_)) tick_ = static_cast<std::int64_t>(wanted);
  if (tick_ >= host_.ticks)
    return refuse(fmt::format("tick {}: the run ends before it, at tick {}", tick_, host_.ticks));
  phase_ = Phase::kApplying;
  replied_.clear();
  request_t own = request_;
  own.value = static_cast<double>(tick_);
  host_.apply(own);
  if (members_.empty()) return done();
  send_phase();
}

void Arbiter::take(const reply_t& reply) {
  if (phase_ == Phase::kIdle || reply.seq != request_.seq || !members_.count(reply.role)) return;
  const bool preparing = phase_ == Phase::kPreparing;
  if (preparing && reply.accepted == 0) {
    if (!refusal_) refusal_ = reply.text;
  } else if (reply.applied_seq != (preparing ? -1 : tick_)) {
    return;
  }
  replied_.insert(reply.role);
  if (replied_ != members_) return;
  if (refusal_) return refuse(*std::exchange(refusal_, {}));
  if (preparing)
    begin_applying();
  else
    done();
}

void Arbiter::refuse(const std::string& why) {
  if (phase_ == Phase::kPreparing) {
    request_t drop{};
    drop.seq = request_.seq;
    drop.kind = static_cast<std::int32_t>(RequestKind::kDrop);
    host_.ask(drop);
  }
  reply_t reply{};
  reply.applied_seq = -1;
  reply.text = why;
  finish(reply);
}

void Arbiter::done() {
  if (is(request_, RequestKind::kSteer)) host_.event(Reason::kSteered, tick_, request_.text);
  reply_t reply{};
  reply.accepted = 1;
  reply.applied_seq = tick_;
  finish(reply);
}

void Arbiter::finish(reply_t reply) {
  reply.seq = request_.seq;
  answered_.push_back(reply);
  if (answered_.size() > kAnswersKept) answered_.pop_front();
  const bool held = phase_ == Phase::kApplying;
  phase_ = Phase::kIdle;
  host_.answer(reply);
  if (held) host_.released();
}

void Arbiter::turn() {
  if (phase_ == Phase::kGathering) return gather();
  if (phase_ == Phase::kPreparing && seconds_since(begun_) > kPatience_s)
    return refuse(
        refusal_.value_or(fmt::format("{} did not answer", names_of(without(members_, replied_)))));
  if (phase_ == Phase::kApplying && host_.margin_ticks > 0 && host_.next_tick() > tick_) {
    const std::string late = names_of(without(members_, replied_));
    if (is(request_, RequestKind::kSteer)) host_.event(Reason::kSteered, tick_, request_.text);
    reply_t reply{};
    reply.applied_seq = tick_;
    reply.text = fmt::format("applied at tick {}, but {} did not confirm it in time", tick_, late);
    return finish(reply);
  }
  if (phase_ != Phase::kIdle && seconds_since(sent_) > kRepeat_s) send_phase();
  watch_holder();
}

void Arbiter::watch_holder() {
  if (holder_.empty()) return;
  const double silent_s = seconds_since(holder_heard_);
  if (silent_s > kSilent_s && !silent_) {
    silent_ = true;
    host_.event(Reason::kControlLost, host_.next_tick(),
                fmt::format("{} is silent: the drive holds", holder_));
  }
  if (silent_s <= kSilent_s + host_.hold_s || phase_ != Phase::kIdle) return;
  host_.event(Reason::kControlLost, host_.next_tick(),
              fmt::format("{} was silent for {:.1f} s: stop", holder_, silent_s));
  holder_.clear();
  request_t stop{};
  stop.seq = new_session_id();
  stop.kind = static_cast<std::int32_t>(RequestKind::kSteer);
  stop.text = "stop";
  begin(stop);
}

}  // namespace twinrate
