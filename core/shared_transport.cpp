#include "core/shared_transport.hpp"

#include <time.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <optional>
#include <utility>

#include "core/port_listeners.hpp"
#include "core/shared_ring.hpp"
#include "core/socket_watch.hpp"

namespace twinrate {
namespace {

bool is_of_a_tick(Channel channel) {
  return channel < Channel::kStatus;
}

using Clock = std::chrono::steady_clock;

// The copies over LCM.
class Copies {
 public:
  explicit Copies(const UdpmAddress& address)
      : sender_(address), stays_here_(address.ttl == 0), listeners_(address.port) {}
  // Sends copies while there is a listener. Listeners on another machine cannot be detected.
  void look(const std::vector<pid_t>& apart) {
    if (!stays_here_ || Clock::now() - looked_ < kLookPeriod) return;
    looked_ = Clock::now();
    wanted_ = listeners_.any(apart);
  }
  void add(const std::string& channel, const std::uint8_t* bytes, std::size_t size) {
    if (!wanted_) return;
    if (messages_.size() == count_) messages_.emplace_back();
    Message& message = messages_[count_++];
    message.channel = &channel;
    message.bytes.assign(bytes, bytes + size);
    if (count_ == kTogether) send();
  }
  void send() {
    std::array<LcmSender::Small, kTogether> list{};
    for (std::size_t i = 0; i < count_; ++i)
      list[i] = {messages_[i].channel, messages_[i].bytes.data(), messages_[i].bytes.size()};
    sender_.send_together(list.data(), std::exchange(count_, 0));
  }

 private:
  static constexpr std::size_t kTogether = LcmSender::kMostTogether;
  static constexpr auto kLookPeriod = std::chrono::milliseconds(50);
  struct Message {
    const std::string* channel;
    std::vector<std::uint8_t> bytes;
  };
  LcmSender sender_;
  bool stays_here_, wanted_ = true;
  PortListeners listeners_;
  Clock::time_point looked_{};
  std::vector<Message>
      messages_;  // the first `count_` are to be sent; the others keep their memory
  std::size_t count_ = 0;
};

class SharedTransport : public BusTransport {
 public:
  SharedTransport(std::unique_ptr<BusTransport> udpm, const UdpmAddress& copies,
                  const SharedTransportOptions& options)
      : udpm_(std::move(udpm)), member_(options.path, options.role), options_(options) {
    if (options.role == Role::kLogger) copies_.emplace(copies);
  }

  void subscribe(const WantedChannel& channel, int port_offset, bool quiet,
                 Handler handler) override {
    if (!is_of_a_tick(channel.channel))
      return udpm_->subscribe(channel, port_offset, quiet, std::move(handler));
    Subscription& s = subscriptions_[static_cast<std::size_t>(channel.channel)];
    s.name = channel.name;
    s.handlers.push_back(std::move(handler));
    member_.want(channel.channel, !quiet && options_.drain_every_ms <= 0);
  }
  void change(const WantedChannel& channel) override {
    if (channel.channel == Channel::kEstimate)
      member_.thin_estimates({channel.every, channel.from});
    else if (!is_of_a_tick(channel.channel))
      udpm_->change(channel);
  }
  void send(const Outgoing* messages, std::size_t count) override {
    bool any = false;
    for (std::size_t i = 0; i < count; ++i) {
      const Outgoing& m = messages[i];
      if (is_of_a_tick(m.id)) {
        member_.put(m.id, m.bytes, m.size);
        any = true;
      } else {
        udpm_->send(&m, 1);
      }
    }
    if (any) member_.publish();
  }
  bool handle(double timeout_ms, bool wake_for_all) override {
    if (pass_on(wake_for_all)) return true;
    if (copies_) send_copies();
    if (options_.drain_every_ms > 0) return wait_draining(timeout_ms, wake_for_all);
    if (!watch_) watch();
    member_.sleep(timeout_ms, wake_for_all);
    return pass_on(wake_for_all);
  }

  std::int64_t malformed() const override { return udpm_->malformed() + member_.malformed(); }
  // The memory has one writer a channel, so senders are not checked.
  std::uint64_t sender() const override { return from_ring_ ? 0 : udpm_->sender(); }
  bool is_own(std::uint64_t sender) const override { return udpm_->is_own(sender); }

 private:
  static constexpr auto kDeafAtMost = std::chrono::milliseconds(1);
  struct Subscription {
    std::string name;
    std::vector<Handler> handlers;
  };

  // Whoever is never without a message in memory still hears the sockets.
  bool pass_on(bool wake_for_all) {
    from_ring_ = false;
    if (readable_.exchange(false, std::memory_order_acquire)) reads_sockets_ = true;
    if (reads_sockets_ && udpm_->handle(0, wake_for_all)) return true;
    reads_sockets_ = false;
    RingMember::Message message{};
    if (!member_.next(message)) return false;
    from_ring_ = true;
    const Subscription& s = subscriptions_[static_cast<std::size_t>(message.channel)];
    if (copies_) copy(s.name, message);
    for (const Handler& handler : s.handlers) handler(message.bytes, message.size);
    return true;
  }
  void copy(const std::string& channel, const RingMember::Message& message) {
    copies_->add(channel, message.bytes, message.size);
    constexpr int kLookEvery = 64;  // messages
    if (++since_look_ < kLookEvery) return;
    since_look_ = 0;
    look_at_sockets();
  }
  void send_copies() {
    copies_->send();
    copies_->look(member_.processes());
  }
  void look_at_sockets() {
    if (Clock::now() - looked_ < kDeafAtMost) return;
    looked_ = Clock::now();
    reads_sockets_ = true;
    send_copies();
  }
  void watch() {
    watch_.emplace(udpm_->sockets(), options_.watch_cpu, [this] {
      readable_.store(true, std::memory_order_release);
      member_.wake();
    });
  }
  bool wait_draining(double timeout_ms, bool wake_for_all) {
    const auto end = Clock::now() + std::chrono::duration<double, std::milli>(timeout_ms);
    while (true) {
      const double left_ms = std::chrono::duration<double, std::milli>(end - Clock::now()).count();
      const double pause_ms = std::clamp(left_ms, 0.0, options_.drain_every_ms);
      const timespec pause{.tv_sec = 0, .tv_nsec = static_cast<long>(pause_ms * 1e6)};
      const bool ended = nanosleep(&pause, nullptr) != 0 || left_ms <= 0;  // a signal, or time-out
      reads_sockets_ = true;
      if (pass_on(wake_for_all)) return true;
      if (ended) return false;
    }
  }

  std::unique_ptr<BusTransport> udpm_;
  RingMember member_;
  SharedTransportOptions options_;
  std::optional<Copies> copies_;
  std::array<Subscription, static_cast<std::size_t>(Channel::kStatus)> subscriptions_;
  std::atomic<bool> readable_ = false;  // set by watch_
  bool reads_sockets_ = false, from_ring_ = false;
  int since_look_ = 0;
  Clock::time_point looked_{};
  std::optional<SocketWatch> watch_;  // the last member: its thread uses the others
};

}  // namespace

std::unique_ptr<BusTransport> make_shared_transport(std::unique_ptr<BusTransport> udpm,
                                                    const UdpmAddress& copies,
                                                    const SharedTransportOptions& options) {
  return std::make_unique<SharedTransport>(std::move(udpm), copies, options);
}

}  // namespace twinrate
