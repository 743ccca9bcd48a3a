#include "tools/watch/watcher.hpp"

#include <fmt/format.h>

#include <chrono>
#include <iterator>

#include "core/decode.hpp"
#include "core/machine_error.hpp"
#include "core/multicast.hpp"
#include "core/reason.hpp"
#include "model/signals.hpp"
#include "tools/doctor/checks.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kEventsKept = 8;
constexpr std::int64_t kSessionSilent_us = 1'000'000;

std::string with_receive_buffer(const std::string& url) {
  if (!url.starts_with("udpm://") || url.find("recv_buf_size") != std::string::npos) return url;
  return url + (url.find('?') == std::string::npos ? "?" : "&") +
         fmt::format("recv_buf_size={}", kWantedReceiveBuffer);
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
    : lcm_(with_receive_buffer(need_route(url))), last_heard_us_(wall_clock_us()) {
  if (!lcm_.good()) throw MachineError(url + ": LCM cannot open this URL; try twinrate doctor");
  for (const ChannelInfo& channel : kChannels) {
    channels_.emplace_back(channel.channel);
    ears_.push_back(std::make_unique<Ear>(Ear{this, channel.channel}));
    lcm::Subscription* subscription =
        lcm_.subscribe(channel.name + channel_suffix, &Ear::hear, ears_.back().get());
    // The first subscription runs LCM's self-test. The instance must not be used after a failure.
    if (!subscription || lcm_.getFileno() < 0)
      throw MachineError("the LCM self-test failed; try twinrate doctor");
    subscription->setQueueCapacity(0);
  }
}

void Watcher::listen(int timeout_ms) {
  // A signal ends the wait early; the caller handles it.
  if (lcm_.handleTimeout(timeout_ms) <= 0) return;
  const std::int64_t enough_us = wall_clock_us() + 50'000;
  while (wall_clock_us() < enough_us && lcm_.handleTimeout(0) > 0) {
  }
}

double Watcher::silent_s() const {
  return 1e-6 * static_cast<double>(wall_clock_us() - last_heard_us_);
}

void Watcher::take(Channel channel, const lcm::ReceiveBuffer& buffer) {
  const auto* bytes = static_cast<const std::uint8_t*>(buffer.data);
  const auto header = read_header(bytes, buffer.data_size);
  if (!header) {
    ++undecodable_;
    return;
  }
  if (!admit(header->session)) return;
  ++heard_;
  last_heard_us_ = wall_clock_us();
  if (channel == Channel::kMeasurement) tick_times_.note(header->seq, buffer.recv_utime);
  channels_[static_cast<std::size_t>(channel)].take(*header, bytes, buffer.data_size,
                                                    buffer.recv_utime, tick_times_);
  if (channel == Channel::kEstimate && runs_on_the_table(bytes, buffer.data_size))
    channels_[static_cast<std::size_t>(Channel::kGain)].pause();
  if (channel == Channel::kEvent) keep_event(bytes, static_cast<int>(buffer.data_size));
  if (channel == Channel::kStatus) keep_status(bytes, static_cast<int>(buffer.data_size));
}

bool Watcher::admit(std::int64_t session) {
  if (session == session_) return true;
  const bool silent = wall_clock_us() - last_heard_us_ > kSessionSilent_us;
  if (session_ != 0 && !silent) {
    ++foreign_;
    return false;
  }
  const std::int64_t now_us = wall_clock_us();
  for (WatchedChannel& account : channels_) {
    account.reset();
    account.begin_interval(now_us);
  }
  processes_.clear();
  session_ = session;
  return true;
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
