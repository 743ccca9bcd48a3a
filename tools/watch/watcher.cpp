#include "tools/watch/watcher.hpp"

#include <fmt/format.h>

#include <chrono>
#include <iterator>

#include "core/decode.hpp"
#include "core/machine_error.hpp"
#include "core/multicast.hpp"
#include "core/reason.hpp"
#include "model/signals.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kEventsKept = 8;
constexpr double kSessionSilent_s = 1;
// Woken by each message, it would take the processor from the drive. About 1 s of an unpaced set
// waits in the socket while the terminal is slow.
constexpr double kDrain_ms = 5;
constexpr int kReceiveBuffer = 32 << 20;

std::string with_receive_buffer(const std::string& url) {
  if (!url.starts_with("udpm://") || url.find("recv_buf_size") != std::string::npos) return url;
  return url + (url.find('?') == std::string::npos ? "?" : "&") +
         fmt::format("recv_buf_size={}", kReceiveBuffer);
}

// An estimate of policy scheduled: no gain of a background (gain_seq -1).
bool runs_on_the_table(const std::uint8_t* bytes, std::size_t size) {
  return (estimate_status(bytes, size) & kScheduledGain) != 0;
}

const std::string& need_route(const std::string& url) {
  if (url.starts_with("udpm://") && !multicast_route_exists(multicast_address_of(url)))
    throw MachineError("no multicast route, LCM cannot work; as root: " + multicast_mend());
  return url;
}

}  // namespace

std::int64_t wall_clock_us() {
  using namespace std::chrono;
  return duration_cast<microseconds>(system_clock::now().time_since_epoch()).count();
}

Watcher::Watcher(const std::string& url, const std::string& channel_suffix)
    : bus_({.url = with_receive_buffer(need_route(url)),
            .channel_suffix = channel_suffix,
            .drain_every_ms = kDrain_ms,
            .authenticate = false}),
      last_heard_us_(wall_clock_us()) {
  for (const ChannelInfo& channel : kChannels) channels_.emplace_back(channel.channel);
  bus_.subscribe_all([this](Channel channel, const std::uint8_t* bytes, std::size_t size,
                            std::int64_t, std::int64_t) { take(channel, bytes, size); },
                     true);
}

void Watcher::listen(int timeout_ms) {
  if (silent_s() > kSessionSilent_s) bus_.adopt(0);
  // A signal ends the wait early; the caller handles it.
  if (!bus_.handle(timeout_ms)) return;
  const std::int64_t enough_us = wall_clock_us() + 50'000;
  while (wall_clock_us() < enough_us && bus_.handle(0)) {
  }
}

double Watcher::silent_s() const {
  return 1e-6 * static_cast<double>(wall_clock_us() - last_heard_us_);
}

void Watcher::take(Channel channel, const std::uint8_t* bytes, std::size_t size) {
  const auto header = read_header(bytes, size);
  if (!header) return;  // the bus lets none through
  if (header->session != session_) begin(header->session);
  ++heard_;
  last_heard_us_ = wall_clock_us();
  const std::int64_t told_us = bus_.arrival_us();
  const std::int64_t arrival_us = told_us > 0 ? told_us : last_heard_us_;
  if (channel == Channel::kMeasurement) tick_times_.note(header->seq, arrival_us);
  channels_[static_cast<std::size_t>(channel)].take(*header, bytes, size, arrival_us, tick_times_);
  if (channel == Channel::kEstimate && runs_on_the_table(bytes, size))
    channels_[static_cast<std::size_t>(Channel::kGain)].pause();
  if (channel == Channel::kEvent) keep_event(bytes, static_cast<int>(size));
  if (channel == Channel::kStatus) keep_status(bytes, static_cast<int>(size));
}

void Watcher::begin(std::int64_t session) {
  const std::int64_t now_us = wall_clock_us();
  for (WatchedChannel& account : channels_) {
    account.reset();
    account.begin_interval(now_us);
  }
  processes_.clear();
  session_ = session;
}

void Watcher::keep_event(const std::uint8_t* bytes, int size) {
  event_t event{};
  if (!decode(event, bytes, static_cast<std::size_t>(size))) {
    ++undecodable_;
    return;
  }
  WatchedEvent kept{.seq = event.seq, .role = role_name(event.role), .text = event.text};
  kept.reason = fmt::format("reason {}", event.reason);
  for (const ReasonText& known : kReasons)
    if (static_cast<int>(known.reason) == event.reason) kept.reason = known.name;
  events_.push_back(std::move(kept));
  if (events_.size() > kEventsKept) events_.pop_front();
}

void Watcher::keep_status(const std::uint8_t* bytes, int size) {
  status_t status{};
  if (!decode(status, bytes, static_cast<std::size_t>(size)))
    ++undecodable_;
  else
    processes_[status.role] = status;
}

}  // namespace twinrate
