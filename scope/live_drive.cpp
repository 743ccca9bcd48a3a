#include "scope/live_drive.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>

#include "core/arbiter.hpp"
#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/drive_hand.hpp"
#include "core/reason.hpp"

namespace twinrate::scope {
namespace {

constexpr double kRepeat_s = 0.1, kTimeout_s = 3.0;
constexpr std::int64_t kBusNotes_us = 100'000;

std::int64_t wall_us() {
  using namespace std::chrono;
  return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

double steady_s() {
  using namespace std::chrono;
  return duration<double>(steady_clock::now().time_since_epoch()).count();
}

bool is(const request_t& request, RequestKind kind) {
  return request.kind == static_cast<std::int32_t>(kind);
}

// If the plant chooses a common tick (core/arbiter.hpp), the replies of the other processes are no
// answer yet. A change of the model is answered by each process with a model; a refusal by any
// process is an answer.
bool is_answer(const request_t& request, const reply_t& reply) {
  const bool decides =
      reply.role == static_cast<int>(Role::kPlant) || reply.role == static_cast<int>(Role::kBridge);
  if (is(request, RequestKind::kSteer) || is(request, RequestKind::kReset) ||
      is(request, RequestKind::kTakeControl) || is(request, RequestKind::kGiveControl))
    return decides;
  const bool of_the_model =
      is(request, RequestKind::kAddEffect) || is(request, RequestKind::kRemoveEffect);
  const bool has_model = !decides && reply.role != static_cast<int>(Role::kLogger);
  return !of_the_model || reply.accepted == 0 || (has_model && reply.applied_seq >= 0);
}

}  // namespace

LiveDrive::LiveDrive(const BusOptions& options, Recording& recording, TokenOf token_of)
    : recording_(recording),
      options_(options),
      token_of_(std::move(token_of)),
      name_(fmt::format("page {:04x}", new_session_id() & 0xffff)),
      last_heard_us_(wall_us()) {
  open_bus();
  url_ = bus_->url();
  url_.erase(std::min(url_.find("&recv_buf_size"), url_.size()));
  thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

// A token tags the messages of the page. The displayed messages may come from a set with another
// token, or without one.
void LiveDrive::open_bus() {
  options_.authenticate = false;
  auto bus = std::make_unique<Bus>(options_);
  bus->subscribe_all([this](Channel channel, const std::uint8_t* bytes, std::size_t size,
                            std::int64_t, std::int64_t) { hear(channel, bytes, size); });
  bus->subscribe<reply_t>([this](const reply_t& reply) { answer(reply); });
  bus_ = std::move(bus);
}

// The bus stays open, because closing it would lose the messages in its socket, DRIVE_MANIFEST
// among them.
void LiveDrive::look_for_token() {
  if (!token_of_ || session_ == 0 || token_session_ == session_) return;
  token_session_ = session_;
  try {
    bus_->tag_with(token_of_(session_));
  } catch (const BadInput&) {  // the run has ended, and its token is gone
  }
}

LiveDrive::~LiveDrive() = default;

double LiveDrive::silent_s() const {
  return 1e-6 * static_cast<double>(wall_us() - last_heard_us_);
}

void LiveDrive::run(const std::stop_token& stop) {
  std::int64_t noted_us = wall_us();
  while (!stop.stop_requested()) {
    bus_->handle(10);
    look_for_token();
    send_requests();
    send_beat();
    if (!bus_->bound() && silent_s() > kSessionSilent_s) bus_->adopt(0);
    const std::int64_t now_us = wall_us();
    if (now_us - noted_us < kBusNotes_us) continue;
    noted_us = now_us;
    recording_.note_bus(now_us);
    recording_.look(now_us);
  }
}

void LiveDrive::hear(Channel channel, const std::uint8_t* bytes, std::size_t size) {
  const auto header = read_header(bytes, size);
  if (!header || header->session == 0) return;
  if (header->session != session_) {
    if (session_ != 0) recording_.restart();
    session_ = header->session;
    const std::lock_guard lock(mutex_);
    holder_.clear();
  }
  const std::int64_t now_us = wall_us();
  if (channel != Channel::kRequest) last_heard_us_ = now_us;  // not the page's own messages
  heard_ = true;
  if (channel == Channel::kEvent) note_holder(bytes, size);
  const std::int64_t arrival_us = bus_ ? bus_->arrival_us() : 0;
  recording_.take(channel, bytes, size, *header, arrival_us > 0 ? arrival_us : now_us);
}

// Notes the holder of the control, as named by the arbiter's event.
void LiveDrive::note_holder(const std::uint8_t* bytes, std::size_t size) {
  event_t event{};
  if (!decode(event, bytes, size)) return;
  const std::string_view text = event.text;
  const std::string_view takes = " takes control";
  const std::lock_guard lock(mutex_);
  if (event.reason == static_cast<int>(Reason::kControlTaken))
    holder_ = text.ends_with(takes) ? text.substr(0, text.size() - takes.size()) : "";
  if (event.reason == static_cast<int>(Reason::kControlLost) && text.ends_with(": stop"))
    holder_.clear();
}

std::string LiveDrive::holder() const {
  const std::lock_guard lock(mutex_);
  return holder_;
}

void LiveDrive::answer(const reply_t& reply) {
  const std::lock_guard lock(mutex_);
  if (reply.seq == beaten_ && reply.accepted == 0) holder_.clear();  // the control was lost
  if (reply.seq == beaten_ && reply.accepted != 0) holder_ = name_;
  for (const auto& asked : asked_) {
    if (asked->request.seq != reply.seq || !is_answer(asked->request, reply)) continue;
    const std::string role = role_name(reply.role);
    const bool known = std::any_of(asked->replies.begin(), asked->replies.end(),
                                   [&](const SteeringReply& r) { return r.role == role; });
    if (known) continue;
    asked->replies.push_back({role, reply.accepted != 0, reply.applied_seq, reply.text});
    if (asked->replies.size() >= asked->wanted || reply.accepted == 0) asked->done = true;
  }
  answered_.notify_all();
}

// A request is repeated until it is answered: a datagram can be lost, and a process that already
// has the request repeats its answer.
void LiveDrive::send_requests() {
  std::vector<request_t> due;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& asked : asked_) {
      if (asked->done) continue;
      if (steady_s() - asked->asked_s > kTimeout_s) {
        asked->done = true;
      } else if (steady_s() - asked->sent_s > kRepeat_s) {
        asked->sent_s = steady_s();
        due.push_back(asked->request);
      }
    }
    std::erase_if(asked_, [](const auto& asked) { return asked->done; });
    answered_.notify_all();
  }
  for (const request_t& request : due) bus_->publish(request);
}

Steering::Replies LiveDrive::ask(RequestKind kind, std::size_t wanted, const std::string& text,
                                 double value) {
  auto asked = std::make_shared<Asked>();
  asked->request = {};
  asked->request.seq = new_session_id();  // unique
  asked->request.kind = static_cast<std::int32_t>(kind);
  asked->request.text = text;
  asked->request.value = value;
  asked->wanted = wanted;
  asked->asked_s = steady_s();
  std::unique_lock lock(mutex_);
  asked_.push_back(asked);
  answered_.wait_for(lock, std::chrono::duration<double>(2 * kTimeout_s),
                     [&] { return asked->done; });
  return asked->replies;
}

// Sends heartbeats as long as the page with the control asks for them.
void LiveDrive::send_beat() {
  const double now = steady_s();
  if (now - beat_asked_s_ > 2 * DriveHand::kBeat_s || now - beat_sent_s_ < DriveHand::kBeat_s)
    return;
  beat_sent_s_ = now;
  request_t request{};
  request.seq = new_session_id();
  request.kind = static_cast<std::int32_t>(RequestKind::kTakeControl);
  request.text = name_;
  request.value = 1;  // keeps it only
  beaten_ = request.seq;
  bus_->publish(request);
}

Steering::Replies LiveDrive::steer(const std::string& lines) {
  return ask(RequestKind::kSteer, 1, holder_line() + lines);
}
Steering::Replies LiveDrive::take_control() {
  const Replies replies = ask(RequestKind::kTakeControl, 1, name_);
  const std::lock_guard lock(mutex_);
  for (const SteeringReply& reply : replies)
    if (reply.accepted) holder_ = name_;
  return replies;
}
Steering::Replies LiveDrive::give_control() {
  beat_asked_s_ = -1;
  return ask(RequestKind::kGiveControl, 1, name_);
}
void LiveDrive::beat() {
  beat_asked_s_ = steady_s();
}
Steering::Replies LiveDrive::start() {
  return steer("start");
}
Steering::Replies LiveDrive::stop() {
  return ask(RequestKind::kSteer, 1, "stop");
}
Steering::Replies LiveDrive::emergency_stop() {
  return ask(RequestKind::kEmergencyStop, 1);
}
Steering::Replies LiveDrive::reset() {
  return ask(RequestKind::kReset, 1, holder_line());
}
Steering::Replies LiveDrive::add_proposed() {
  return ask(RequestKind::kAddProposed, 1, holder_line());
}
// Three answers: estimator, gain and controller change their model.
Steering::Replies LiveDrive::add_effects(const std::string& toml) {
  return ask(RequestKind::kAddEffect, 3, holder_line() + toml);
}
Steering::Replies LiveDrive::remove_effects(const std::string& toml) {
  return ask(RequestKind::kRemoveEffect, 3, holder_line() + toml);
}

}  // namespace twinrate::scope
