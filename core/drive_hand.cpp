#include "core/drive_hand.hpp"

#include <filesystem>
#include <utility>

#include "core/arbiter.hpp"
#include "core/message_tag.hpp"
#include "core/seconds_since.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

request_t new_request(RequestKind kind, const std::string& text) {
  request_t request{};
  request.seq = new_session_id();  // unique
  request.kind = static_cast<std::int32_t>(kind);
  request.text = text;
  return request;
}

bool decides(int role) {
  return role == static_cast<int>(Role::kPlant) || role == static_cast<int>(Role::kBridge);
}

// A launched set asks for the token in its run directory.
std::string token_of(const RunningSet& set) {
  const auto file = std::filesystem::path(set.directory) / kTokenFile;
  return !set.directory.empty() && std::filesystem::exists(file) ? file.string() : "";
}

}  // namespace

DriveHand::DriveHand(const RunningSet& set, std::string holder, double patience_s)
    : holder_(std::move(holder)),
      patience_s_(patience_s),
      bus_({.url = set.url,
            .channel_suffix = set.channel_suffix,
            .session = set.session,
            .role = Role::kSupervisor,
            .token_file = token_of(set)}) {
  bus_.subscribe<reply_t>([this](const reply_t& reply) {
    if (reply.seq == beaten_ && decides(reply.role)) has_control_ = reply.accepted != 0;
    if (reply.seq != asked_ || !decides(reply.role) || answer_.answered) return;
    answer_.answered = true;
    answer_.accepted = reply.accepted != 0;
    answer_.k = reply.applied_seq;
    answer_.t_ns = reply.t_ns;
    answer_.why = reply.text;
  });
  if (!bus_.bound()) wait_for_session();
}

// A request carries the session of the drive.
void DriveHand::wait_for_session() {
  bus_.subscribe<status_t>([](const status_t&) {});
  const auto begun = Clock::now();
  while (bus_.session() == 0 && seconds_since(begun) < patience_s_) bus_.handle(20);
}

HandAnswer DriveHand::ask(RequestKind kind, const std::string& text, std::int64_t tick) {
  request_t request = new_request(kind, text);
  request.value = static_cast<double>(tick);
  answer_ = {};
  asked_ = request.seq;
  if (bus_.session() == 0) {
    answer_.why = "no drive on the bus";
    return answer_;
  }
  const auto begun = Clock::now();
  while (!answer_.answered && seconds_since(begun) < patience_s_) {
    bus_.publish(request);  // the plant answers a repeated request again
    const auto sent = Clock::now();
    while (!answer_.answered && seconds_since(sent) < kRepeat_s) bus_.handle(20);
  }
  answer_.waited_s = seconds_since(begun);
  if (!answer_.answered) answer_.why = "the drive did not answer";
  return answer_;
}

HandAnswer DriveHand::steer(const std::string& lines, std::int64_t tick) {
  return ask(RequestKind::kSteer, holder_line() + lines, tick);
}

std::string DriveHand::holder_line() const {
  return holder_.empty() ? "" : Arbiter::kHolderLine + holder_ + "\n";
}

HandAnswer DriveHand::take_control() {
  const HandAnswer answer = ask(RequestKind::kTakeControl, holder_);
  has_control_ = answer.accepted;
  return answer;
}

HandAnswer DriveHand::give_control() {
  has_control_ = false;
  return ask(RequestKind::kGiveControl, holder_);
}

void DriveHand::beat() {
  for (int i = 0; i < kMostAtOnce && bus_.handle(0); ++i) {
  }
  if (seconds_since(beat_at_) < kBeat_s) return;
  beat_at_ = Clock::now();
  request_t request = new_request(RequestKind::kTakeControl, holder_);
  request.value = 1;  // keeps it only
  beaten_ = request.seq;
  bus_.publish(request);
}

}  // namespace twinrate
