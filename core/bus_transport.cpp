#include "core/bus_transport.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sched.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <utility>

#include "core/later_sender.hpp"
#include "core/machine_error.hpp"
#include "core/multicast.hpp"

namespace twinrate {
namespace {

timespec to_timespec(double ms) {
  const auto ns = static_cast<std::int64_t>(std::max(0.0, ms) * 1e6);
  return {.tv_sec = ns / 1'000'000'000, .tv_nsec = ns % 1'000'000'000};
}

class UdpmTransport : public BusTransport {
 public:
  UdpmTransport(const UdpmAddress& address, const UdpmOptions& options)
      : address_(address),
        later_cpu_(options.later_cpu),
        filter_(options.filter),
        drain_every_ms_(options.drain_every_ms),
        spin_us_(options.spin_us) {
    if (!multicast_is_heard(address))
      throw MachineError("the LCM self-test failed; as root: " + multicast_mend());
  }

  void subscribe(const WantedChannel& channel, int port_offset, bool quiet,
                 Handler handler) override {
    Port& port = port_at(port_offset, quiet);
    port.subscriptions.push_back({channel, std::move(handler)});
    apply_filter(port);
  }

  void change(const WantedChannel& channel) override {
    for (const auto& port : ports_)
      for (Subscription& s : port->subscriptions)
        if (s.channel.name == channel.name) {
          s.channel = channel;
          apply_filter(*port);
        }
  }

  void send(const Outgoing* messages, std::size_t count) override {
    together_.clear();
    for (std::size_t i = 0; i < count; ++i) {
      const Outgoing& m = messages[i];
      if (goes_later(m)) {
        later_->send(*m.channel, m.bytes, m.size);
        continue;
      }
      together_.push_back({m.channel, m.bytes, m.size});
      if (i + 1 < count && !goes_later(messages[i + 1]) &&
          messages[i + 1].port_offset == m.port_offset)
        continue;
      sender(m.port_offset).send_together(together_.data(), together_.size());
      together_.clear();
    }
  }

  bool handle(double timeout_ms, bool wake_for_all) override {
    if (pass_on()) return true;
    wait(timeout_ms, wake_for_all);
    return pass_on();
  }

  std::int64_t arrival_us() const override { return arrival_us_; }
  std::uint64_t sender() const override { return sender_; }
  bool is_own(std::uint64_t sender) const override {
    if (later_ && later_->name() == sender) return true;
    return std::any_of(senders_.begin(), senders_.end(),
                       [&](const auto& own) { return own.second->name() == sender; });
  }

  std::vector<int> sockets() const override {
    std::vector<int> list;
    for (const auto& port : ports_) list.push_back(port->receiver.fd());
    return list;
  }

  std::int64_t malformed() const override {
    std::int64_t sum = 0;
    for (const auto& port : ports_) sum += port->receiver.malformed();
    return sum;
  }

 private:
  // Below it the time-out of a socket, in ticks of the kernel's clock, is too coarse.
  static constexpr double kCoarse_ms = 8;
  static constexpr std::size_t kBatch = 8, kDrainBatch = 64;
  // A socket read only every drain_every_ms must hold the messages of that time.
  static constexpr int kDrainBuffer = 1 << 20;

  struct Subscription {
    WantedChannel channel;
    Handler handler;
  };
  struct Port {
    Port(const UdpmAddress& address, int port_offset, bool is_quiet, std::size_t batch,
         bool stamped)
        : offset(port_offset), quiet(is_quiet), receiver(address, batch, stamped) {}
    int offset;
    bool quiet;
    LcmReceiver receiver;
    std::vector<Subscription> subscriptions;
  };

  UdpmAddress at(int port_offset) const {
    UdpmAddress address = address_;
    address.port = static_cast<std::uint16_t>(address.port + port_offset);
    return address;
  }
  // Quiet ports first: their messages are handled before the one that woke the process.
  Port& port_at(int offset, bool quiet) {
    for (const auto& port : ports_)
      if (port->offset == offset && port->quiet == quiet) return *port;
    auto made = std::make_unique<Port>(
        at(offset), offset, quiet, drain_every_ms_ > 0 ? kDrainBatch : kBatch, drain_every_ms_ > 0);
    if (made->receiver.granted_buffer() < kDrainBuffer) drain_every_ms_ = 0;
    Port& port = *made;
    ports_.insert(quiet ? ports_.begin() : ports_.end(), std::move(made));
    return port;
  }
  // A channel has one socket: a message sent later once is sent later again when it is repeated. A
  // process without such messages has no thread for them.
  bool goes_later(const Outgoing& m) {
    if (later_cpu_ < 0 || m.port_offset != 0) return false;
    const auto known = std::find(later_channels_.begin(), later_channels_.end(), m.channel);
    if (known != later_channels_.end()) return true;
    if (!m.later) return false;
    if (!later_) later_ = std::make_unique<LaterSender>(address_, later_cpu_);
    later_channels_.push_back(m.channel);
    return true;
  }
  LcmSender& sender(int offset) {
    auto& slot = senders_[offset];
    if (!slot) slot = std::make_unique<LcmSender>(at(offset));
    return *slot;
  }
  void apply_filter(const Port& port) {
    if (!filter_) return;
    std::vector<WantedChannel> wanted;
    for (const Subscription& s : port.subscriptions) {
      const auto same = std::find_if(wanted.begin(), wanted.end(), [&](const WantedChannel& w) {
        return w.name == s.channel.name;
      });
      if (same == wanted.end()) wanted.push_back(s.channel);
    }
    filter_channels(port.receiver.fd(), wanted);
  }

  // The next message that was read and that somebody wants.
  bool pass_on() {
    for (const auto& port : ports_) {
      LcmMessage message;
      while (port->receiver.next(message) ||
             (port->receiver.was_full() && port->receiver.read_now() &&
              port->receiver.next(message))) {
        arrival_us_ = message.arrival_us;
        sender_ = message.sender;
        if (pass_on(*port, message)) return true;
      }
    }
    return false;
  }
  static bool pass_on(Port& port, const LcmMessage& message) {
    bool wanted = false;
    for (std::size_t i = 0; i < port.subscriptions.size(); ++i) {
      if (port.subscriptions[i].channel.name != message.channel) continue;
      wanted = true;
      port.subscriptions[i].handler(message.bytes, message.size);
    }
    return wanted;
  }

  void wait(double timeout_ms, bool wake_for_all) {
    if (drain_every_ms_ > 0) return wait_draining(timeout_ms);
    if (spin_us_ > 0 && timeout_ms > 0) {
      const double spun_us = std::min(1e3 * timeout_ms, spin_us_);
      if (spin(spun_us)) return;
      timeout_ms -= 1e-3 * spun_us;
    }
    Port* lone = wake_for_all || timeout_ms < kCoarse_ms ? nullptr : lone_waking_port();
    if (lone)
      lone->receiver.read_waiting(timeout_ms);
    else
      poll_ports(timeout_ms, wake_for_all);
    for (const auto& port : ports_)
      if (port->quiet && !port->receiver.has_read()) port->receiver.read_now();
  }
  // Others of the same priority on this CPU have their turn between two looks.
  bool spin(double limit_us) {
    using Clock = std::chrono::steady_clock;
    const auto end = Clock::now() + std::chrono::duration<double, std::micro>(limit_us);
    while (!read_all())
      if (sched_yield(); Clock::now() >= end) return false;
    return true;
  }
  Port* lone_waking_port() {
    Port* found = nullptr;
    for (const auto& port : ports_) {
      if (port->quiet) continue;
      if (found) return nullptr;
      found = port.get();
    }
    return found;
  }
  void poll_ports(double timeout_ms, bool wake_for_all) {
    polled_.clear();
    for (const auto& port : ports_)
      if (!port->quiet || wake_for_all)
        polled_.push_back({.fd = port->receiver.fd(), .events = POLLIN, .revents = 0});
    const timespec timeout = to_timespec(timeout_ms);
    if (ppoll(polled_.data(), polled_.size(), &timeout, nullptr) <= 0) return;
    std::size_t index = 0;
    for (const auto& port : ports_)
      if ((!port->quiet || wake_for_all) && (polled_[index++].revents & POLLIN) != 0)
        port->receiver.read_now();
  }
  bool read_all() {
    bool any = false;
    for (const auto& port : ports_) any = port->receiver.read_now() || any;
    return any;
  }
  void wait_draining(double timeout_ms) {
    using Clock = std::chrono::steady_clock;
    const auto end = Clock::now() + std::chrono::duration<double, std::milli>(timeout_ms);
    while (!read_all()) {
      const double left_ms = std::chrono::duration<double, std::milli>(end - Clock::now()).count();
      const timespec pause = to_timespec(std::min(drain_every_ms_, left_ms));
      if (left_ms <= 0 || nanosleep(&pause, nullptr) != 0) return;  // time-out, or a signal
    }
  }

  UdpmAddress address_;
  std::int64_t arrival_us_ = 0;
  std::uint64_t sender_ = 0;
  int later_cpu_;
  std::vector<const std::string*> later_channels_;
  bool filter_;
  double drain_every_ms_, spin_us_;
  std::vector<std::unique_ptr<Port>> ports_;
  std::map<int, std::unique_ptr<LcmSender>> senders_;
  std::vector<LcmSender::Small> together_;
  std::unique_ptr<LaterSender> later_;
  std::vector<pollfd> polled_;
};

class LiblcmTransport : public BusTransport {
 public:
  explicit LiblcmTransport(const std::string& url) : lcm_(url) {
    if (!lcm_.good())
      throw MachineError(fmt::format("{}: LCM cannot open this URL; try twinrate doctor", url));
  }
  void subscribe(const WantedChannel& channel, int, bool, Handler handler) override {
    subscriptions_.push_back(
        std::make_unique<Subscription>(Subscription{this, std::move(handler)}));
    lcm::Subscription* subscription =
        lcm_.subscribe(channel.name, &Subscription::receive, subscriptions_.back().get());
    // The first subscription runs LCM's self-test; if it fails, the instance must not be used.
    if (!subscription || !lcm_.good() || lcm_.getFileno() < 0)
      throw MachineError("the LCM self-test failed; try twinrate doctor");
    subscription->setQueueCapacity(0);  // unbounded: a full queue would drop the newest message
  }
  void send(const Outgoing* messages, std::size_t count) override {
    for (std::size_t i = 0; i < count; ++i)
      lcm_.publish(*messages[i].channel, messages[i].bytes,
                   static_cast<unsigned>(messages[i].size));
  }
  bool handle(double timeout_ms, bool) override {
    pollfd descriptor{.fd = lcm_.getFileno(), .events = POLLIN, .revents = 0};
    const timespec timeout = to_timespec(timeout_ms);
    if (ppoll(&descriptor, 1, &timeout, nullptr) <= 0) return false;
    lcm_.handle();
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
    return true;
  }

 private:
  struct Subscription {
    LiblcmTransport* owner;
    Handler handler;
    // An exception must not cross LCM's own frames.
    void receive(const lcm::ReceiveBuffer* buffer, const std::string&) {
      try {
        handler(static_cast<const std::uint8_t*>(buffer->data), buffer->data_size);
      } catch (...) {
        owner->thrown_ = std::current_exception();
      }
    }
  };
  lcm::LCM lcm_;
  std::vector<std::unique_ptr<Subscription>> subscriptions_;
  std::exception_ptr thrown_;
};

}  // namespace

std::unique_ptr<BusTransport> make_udpm_transport(const UdpmAddress& address,
                                                  const UdpmOptions& options) {
  return std::make_unique<UdpmTransport>(address, options);
}

std::unique_ptr<BusTransport> make_liblcm_transport(const std::string& url) {
  return std::make_unique<LiblcmTransport>(url);
}

}  // namespace twinrate
