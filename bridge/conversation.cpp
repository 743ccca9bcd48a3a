#include "bridge/conversation.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "core/reason.hpp"

namespace twinrate {

Conversation::Conversation(const BridgeParameters& bridge, const DriveConfig& drive)
    : bridge_(bridge),
      f_s_Hz_(drive.rates.f_s_Hz),
      protocol_(make_protocol(bridge, drive)),
      link_(open_link(bridge.port, bridge.baud)),
      last_heard_ns_(now_ns()) {}

// More than once: a frame can be lost, and nothing comes after it.
Conversation::~Conversation() {
  for (int i = 0; i < 3 && drove_; ++i) off();
}

void Conversation::ask(const Bytes& question) {
  protocol_->asked(now_ns());
  link_->send(question);
}

bool Conversation::pump(double timeout_ms) {
  if (const Bytes poll = protocol_->poll(now_ns()); !poll.empty()) ask(poll);
  const auto bytes = link_->receive(timeout_ms);
  if (bytes.empty()) return false;
  const std::int64_t frames = protocol_->counts().frames;
  protocol_->take(bytes, now_ns());
  if (protocol_->counts().frames != frames) last_heard_ns_ = now_ns();
  return true;
}

const DriveInfo& Conversation::greet(bool lockstep, double patience_s) {
  constexpr double kAskAgain_ms = 100;
  const std::int64_t begun = now_ns();
  while (!protocol_->info()) {
    if (!link_->is_open()) throw MachineError(bridge_.port + ": the line has ended");
    if (1e-9 * static_cast<double>(now_ns() - begun) > patience_s)
      throw MachineError(
          fmt::format("{}: no answer of a drive within {:g} s (bridge.protocol = {})", bridge_.port,
                      patience_s, kDriveProtocolNames[static_cast<int>(bridge_.protocol)]));
    ask(protocol_->hello(lockstep));
    for (const std::int64_t asked = now_ns();
         !protocol_->info() && 1e-6 * static_cast<double>(now_ns() - asked) < kAskAgain_ms;)
      pump(10);
  }
  const DriveInfo& info = *protocol_->info();
  if (info.f_s_Hz > 0 && std::abs(info.f_s_Hz / f_s_Hz_ - 1) > 1e-3)
    throw BadInput(fmt::format("rates.f_s_Hz: the drive on {} samples at {:g} Hz, found {:g}",
                               bridge_.port, info.f_s_Hz, f_s_Hz_));
  return info;
}

std::optional<double> Conversation::round_trip_us(double patience_ms) {
  protocol_->forget_info();
  const Bytes question = protocol_->hello(false);
  if (question.empty()) return {};
  const std::int64_t asked = now_ns();
  ask(question);
  while (!protocol_->info() && 1e-6 * static_cast<double>(now_ns() - asked) < patience_ms) pump(1);
  if (!protocol_->info()) return {};
  return 1e-3 * static_cast<double>(now_ns() - asked);
}

void Conversation::command(const DriveCommand& command) {
  drove_ = true;
  last_ = protocol_->command(command);
  protocol_->asked(now_ns());
  link_->send(last_);
}

std::string Conversation::account() const {
  const LinkCounts& c = protocol_->counts();
  return fmt::format(
      "{} frames; damaged {}, lost {}, doubled {}, late {}; restarts {}{}{}; device clock {}",
      c.frames, c.damaged, c.lost, c.doubled, c.late, c.resets,
      c.timed == 0 ? ""
                   : fmt::format("; moments of {} samples known within {:.0f} us (mean; {:.0f} at "
                                 "most), {} left out for a longer round trip",
                                 c.timed, c.within_us_mean(), c.within_us_most, c.untimed),
      c.answered == 0 ? ""
                      : fmt::format("; commands taken after {:.2f} ticks, {} at most, {} late",
                                    c.answer_ticks_mean(), c.answer_ticks_most, c.command_late),
      clock_text());
}

std::string Conversation::clock_text() const {
  const DeviceClock& clock = protocol_->clock();
  if (protocol_->time() == HostProtocol::Time::kNone) return "not told";
  if (!clock.settled()) return "heard for less than 3.2 s";
  if (std::abs(clock.drift()) > 0.01)
    return fmt::format("at {:.3g} of the host's rate", 1 / (1 + clock.drift()));
  if (protocol_->time() == HostProtocol::Time::kMilliseconds) return "told in milliseconds";
  return fmt::format("{:+.0f} ppm against the host's", -1e6 * clock.drift());
}

std::string Conversation::to_json() const {
  const LinkCounts& c = protocol_->counts();
  nlohmann::ordered_json json = {{"port", bridge_.port},          {"frames", c.frames},
                                 {"damaged", c.damaged},          {"lost", c.lost},
                                 {"doubled", c.doubled},          {"late", c.late},
                                 {"restarts", c.resets},          {"unsent", link_->unsent()},
                                 {"device_clock_ppm", nullptr},   {"command_ticks_mean", nullptr},
                                 {"command_ticks_most", nullptr}, {"commands_late", c.command_late},
                                 {"timed_within_us", nullptr},    {"untimed", c.untimed}};
  if (c.timed > 0) json["timed_within_us"] = c.within_us_mean();
  if (c.answered > 0) {
    json["command_ticks_mean"] = c.answer_ticks_mean();
    json["command_ticks_most"] = c.answer_ticks_most;
  }
  if (protocol_->time() == HostProtocol::Time::kMicroseconds && protocol_->clock().settled())
    json["device_clock_ppm"] = -1e6 * protocol_->clock().drift();
  return json.dump(2) + "\n";
}

}  // namespace twinrate
