// The bus: LCM with sessions, sequence numbers, an account of losses, and messages that can be sent
// again.
//
// A Bus belongs to one thread. It is bound to a session (the supervisor's) or unbound; an unbound
// one adopts the first session it hears. Messages of another session are refused and counted. A
// message is checked whole (core/message_check) before anything decodes it; one that fails is
// counted as undecodable and goes no further. Every receiver counts gaps. Messages published lately are kept, so that a receiver can request one
// (DRIVE_ACK). Not on the tick path of the mathematics: LCM itself allocates.
#pragma once
#include <array>
#include <cstdint>
#include <exception>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/channels.hpp"
#include "core/decode.hpp"

namespace twinrate {

inline constexpr const char* kDefaultUrl = "udpm://239.255.76.67:7667?ttl=0";

// `wanted`, else LCM_DEFAULT_URL, else kDefaultUrl. Throws BadInput where LCM could not understand
// it.
std::string resolve_url(const std::string& wanted);
// Throws BadInput where LCM could not use it in a channel's name.
void check_channel_suffix(const std::string& suffix);

struct BusOptions {
  std::string url;             // empty: LCM_DEFAULT_URL, else kDefaultUrl
  std::string channel_suffix;  // puts several drives side by side on one bus
  std::int64_t session = 0;    // 0: unbound
  bool follow = false;         // take a new session over when one starts
  double drop_rate = 0;        // share of datagrams thrown away on reception (testing)
  bool split_ports = false;    // the ring's links on UDP ports of their own
  bool filter = true;          // unwanted channels do not wake this process (core/channel_filter)
  Role role = Role::kSupervisor;
  // GAIN messages after one tick up to another, so that gaps can be counted. Empty: not counted.
  std::function<std::int64_t(std::int64_t first, std::int64_t last)> gains_between;
  // Messages of a tick from this one on are refused. The default allows every tick.
  std::int64_t ticks = INT64_MAX;
  std::size_t history = 2048;  // messages a channel kept for sending again
};

struct BusCounters {
  std::int64_t gaps = 0, refused = 0, undecodable = 0, dropped_on_purpose = 0, resent = 0;
};

class Bus {
 public:
  // Throws std::runtime_error where the machine has no multicast route (the message names the
  // remedy) and BadInput where the URL or suffix is malformed.
  explicit Bus(const BusOptions& options);
  ~Bus();
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  std::int64_t session() const { return session_; }
  bool bound() const { return bound_; }
  // Begins a session of its own (the process that sets the pace, run without a supervisor).
  void adopt(std::int64_t session) { session_ = session; }
  const BusCounters& counters() const { return counters_; }
  // Counts a message of this session that its receiver did not use: of a tick that cannot be yet,
  // or not plausible.
  void refuse() { ++counters_.refused; }
  const std::string& url() const { return options_.url; }

  // Handler gets every whole message of the session, in the order of arrival.
  template <class Message>
  void subscribe(std::function<void(const Message&)> handler);
  // Every message of every channel, raw: for the logger. Session and loss rules as above.
  using RawHandler = std::function<void(Channel, const std::uint8_t* bytes, std::size_t size,
                                        std::int64_t seq, std::int64_t t_ns)>;
  void subscribe_all(const RawHandler& handler);

  // Stamps the session and sends; kept for sending again where seq >= 0.
  template <class Message>
  void publish(Message message);
  // Sends the latest message of a channel again with the same seq; false where it is no longer
  // kept.
  bool send_again(Channel channel, std::int64_t seq);

  // Handles what arrives within `timeout_ms`; false where nothing arrived. An exception of a
  // handler is thrown here: it must not cross LCM's own frames.
  bool handle(double timeout_ms);
  // Called when a message of a new session arrives at a bus that follows.
  void on_new_session(std::function<void()> handler) { new_session_ = std::move(handler); }

 private:
  struct Kept {
    std::int64_t seq = -1;
    std::vector<std::uint8_t> bytes;
  };
  struct History {
    std::vector<Kept> ring;
    std::size_t next = 0;
  };
  struct Link;  // one lcm::LCM instance with its subscriptions

  lcm::LCM& link(Channel channel);
  std::string name_of(Channel channel) const;
  void subscribe_raw(Channel channel, RawHandler handler);
  void received(Channel channel, const lcm::ReceiveBuffer* buffer, const RawHandler& handler);
  bool admit(Channel channel, std::int64_t seq, std::int64_t session);
  void count_gap(Channel channel, std::int64_t seq);
  void send(Channel channel, std::int64_t seq, const std::uint8_t* bytes, std::size_t size);
  void serve_missing(const ack_t& ack);

  BusOptions options_;
  std::int64_t session_;
  bool bound_;
  BusCounters counters_;
  std::uint64_t datagrams_seen_ = 0;
  std::array<std::int64_t, kChannelCount> first_seq_, last_seq_;
  std::array<History, kChannelCount> history_;
  std::vector<std::uint8_t> scratch_;
  std::map<int, std::unique_ptr<Link>> links_;  // by UDP port offset
  std::function<void()> new_session_;
  std::exception_ptr thrown_;
};

// Fresh session id: not 0, unlikely to meet another.
std::int64_t new_session_id();

template <class Message>
void Bus::subscribe(std::function<void(const Message&)> handler) {
  subscribe_raw(kChannelOf<Message>,
                [this, handler = std::move(handler)](Channel, const std::uint8_t* bytes,
                                                     std::size_t size, std::int64_t, std::int64_t) {
                  Message message;
                  if (!decode(message, bytes, size))
                    ++counters_.undecodable;
                  else
                    handler(message);
                });
}

template <class Message>
void Bus::publish(Message message) {
  message.session = session_;
  const int size = message.getEncodedSize();
  scratch_.resize(static_cast<std::size_t>(size));
  message.encode(scratch_.data(), 0, size);
  send(kChannelOf<Message>, message.seq, scratch_.data(), scratch_.size());
}

}  // namespace twinrate
