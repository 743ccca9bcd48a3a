// The bus: LCM with sessions, sequence numbers, a loss account, and repeated sending of messages.
//
// udpm URLs have sockets of this project (core/lcm_socket); others have liblcm's.
//
// A Bus belongs to one thread. It is bound to a session (the supervisor's) or unbound; an unbound
// one adopts the first session that it hears. Messages of another session are refused and counted.
// A message is checked as a whole (core/message_check) before it is decoded, and in a launched set
// its tag (core/message_tag) is checked before that. A message that fails is counted as undecodable
// and dropped. Every receiver counts gaps. The latest published messages are kept, so that a
// receiver can request one (DRIVE_ACK).
#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "core/channels.hpp"
#include "core/decode.hpp"
#include "core/message_tag.hpp"
#include "core/rates.hpp"
#include "core/sender_table.hpp"

namespace twinrate {

inline constexpr const char* kDefaultUrl = "udpm://239.255.76.67:7667?ttl=0";

// `wanted`, else LCM_DEFAULT_URL, else kDefaultUrl. Throws BadInput if LCM would not understand it.
std::string resolve_url(const std::string& wanted);
// Throws BadInput if LCM could not use it in the name of a channel.
void check_channel_suffix(const std::string& suffix);

class BusTransport;    // core/bus_transport.hpp
struct WantedChannel;  // core/channel_filter.hpp

struct BusOptions {
  std::string url;             // empty: LCM_DEFAULT_URL, else kDefaultUrl
  std::string channel_suffix;  // puts several drives side by side on one bus
  std::int64_t session = 0;    // 0: unbound
  bool follow = false;         // take a new session over when one starts; answers start none
  double drop_rate = 0;        // share of datagrams thrown away on reception (testing)
  bool split_ports = false;    // the ring's links on UDP ports of their own
  bool filter = true;          // unwanted channels do not wake this process (core/channel_filter)
  Role role = Role::kSupervisor;
  // GAIN messages after one tick up to another, so that gaps can be counted. Empty: not counted.
  std::function<std::int64_t(std::int64_t first, std::int64_t last)> gains_between;
  // Messages of a tick from this one on are refused. The default allows every tick.
  std::int64_t ticks = INT64_MAX;
  // Above 0, realtime: a message whose tick is this much ahead of the last one on its channel is
  // refused, unless it follows a refused one: after a gap in the sequence the second message is
  // accepted. Estimates that are filtered for the background may be two periods further ahead. GAIN
  // is not checked.
  std::int64_t max_jump = 0;
  std::size_t history = 2048;  // messages a channel kept for sending again
  // Above 0: messages do not wake the process; it reads them with this period. For a process for
  // which no other process waits: a wake-up costs the sender more than the message.
  double drain_every_ms = 0;
  // Polls for a message for this time before it sleeps.
  double spin_us = 0;
  // Not negative: publish_later() leaves the sending to a thread on this CPU.
  int later_cpu = -1;
  // A token file (core/message_tag) for the tags of sent messages. "": no tags.
  std::string token_file;
  // SharedMemory::path(): the messages of a tick go through it (core/shared_ring), this process being one of
  // plant, estimator, gain, controller and logger. "": as all others do.
  std::string shared_memory;
  bool authenticate = true;  // with a token: a message without a valid tag is refused
};

// A message of a quiet channel does not wake the process. It is read at the next wake-up, and
// handled before the message that caused the wake-up.
enum class Wake { kAtOnce, kQuiet };

struct BusCounters {
  std::int64_t gaps = 0, refused = 0, undecodable = 0, dropped_on_purpose = 0, resent = 0;
};

class Bus {
 public:
  // Throws std::runtime_error if the machine has no multicast route (the message names the remedy),
  // and BadInput if the URL or suffix is malformed.
  explicit Bus(const BusOptions& options);
  ~Bus();
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;

  std::int64_t session() const { return session_; }
  bool bound() const { return bound_; }
  // Tags the messages sent from now on by this file; "": without tags. Throws BadInput.
  void tag_with(const std::string& token_file);
  // Messages without a valid tag are refused.
  bool checks_tags() const { return tagger_ && options_.authenticate; }
  // Begins a session of its own (the process that sets the pace, run without a supervisor).
  void adopt(std::int64_t session) { session_ = session; }
  BusCounters counters() const;
  // Counts a message of this session that its receiver did not use: of a tick that cannot be yet,
  // or not plausible.
  void refuse() { ++counters_.refused; }
  const std::string& url() const { return options_.url; }
  // In a launched set that checks tags every role has one sender (core/sender_table). Called when a
  // message of a second one is refused.
  struct SecondSender {
    Channel channel;
    int role;  // -1: the channel's
    SocketName socket;
  };
  void on_second_sender(std::function<void(const SecondSender&)> handler) {
    second_sender_ = std::move(handler);
  }
  // Sender of the message that is being handled; 0: the transport does not provide it.
  SocketName sender() const;
  // True if it comes from the process of this role, which can be this process. Also true if senders
  // are not checked.
  bool is_from(Role role) const;
  // Called with every status of this process's role from another process.
  void on_twin(std::function<void(const status_t&)> handler) { twin_ = std::move(handler); }
  // A process of this role was started again.
  void forget_sender(Role role) { senders_.forget(role); }
  // Called when a request is refused because it has no valid tag.
  void on_untagged_request(std::function<void()> handler) {
    untagged_request_ = std::move(handler);
  }

  // Handler gets every whole message of the session, in the order of arrival.
  template <class Message>
  void subscribe(std::function<void(const Message&)> handler, Wake wake = Wake::kAtOnce);
  // While true, messages of quiet channels wake the process, too: it waits for one.
  void wake_for_all(bool all) { wake_for_all_ = all; }
  // Subscribes to the ESTIMATE messages that are snapshots at this rate or request a gain
  // (kGainEveryTick); a second call adds its rate. The other estimates need not arrive and count as
  // no gap.
  void want_estimates(BackgroundRate rate);
  // Every message of every channel, raw: for the logger, and with its acknowledgements for who shows
  // the bus. Session and loss rules as above.
  using RawHandler = std::function<void(Channel, const std::uint8_t* bytes, std::size_t size,
                                        std::int64_t seq, std::int64_t t_ns)>;
  void subscribe_all(const RawHandler& handler, bool with_acks = false);

  // Stamps the session and sends, several messages with one system call. A message with seq >= 0 is
  // kept for repeated sending.
  template <class... Message>
  void publish(Message... messages);
  // For a message that nobody waits for: later messages may leave before it.
  template <class Message>
  void publish_later(Message message);
  // Sends the latest message of a channel again with the same seq; false if it is no longer kept.
  bool send_again(Channel channel, std::int64_t seq);

  // Handles the messages of `timeout_ms`; false if none arrived. An exception of a handler is
  // thrown here, because it must not cross LCM's own frames.
  bool handle(double timeout_ms);
  // When the message that a handler has now arrived here, wall clock; 0: unknown (only with
  // drain_every_ms).
  std::int64_t arrival_us() const;
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
  struct Staged {
    Channel channel;
    bool later;
    std::vector<std::uint8_t> bytes;
  };

  const std::string& name_of(Channel channel) const {
    return names_[static_cast<std::size_t>(channel)];
  }
  void subscribe_raw(Channel channel, RawHandler handler, Wake wake);
  void received(Channel channel, const std::uint8_t* bytes, std::size_t size,
                const RawHandler& handler);
  bool is_genuine(Channel channel, const std::uint8_t* bytes, std::size_t size);
  bool is_of_its_sender(Channel channel, const std::uint8_t* bytes, std::size_t size);
  bool admit(Channel channel, std::int64_t seq, std::int64_t session);
  bool jumps(Channel channel, std::int64_t seq);
  void count_gap(Channel channel, std::int64_t seq);
  WantedChannel wanted(Channel channel) const;
  std::int64_t gap(Channel channel, std::int64_t last, std::int64_t seq) const;
  template <class Message>
  void stage(Message& message);
  void keep(Channel channel, std::int64_t seq, const std::vector<std::uint8_t>& bytes);
  void send_staged();
  void serve_missing(const ack_t& ack);

  BusOptions options_;
  std::int64_t session_;
  bool bound_;
  bool hears_leaders_ = false;  // more than answers
  BusCounters counters_;
  std::uint64_t datagrams_seen_ = 0;
  std::array<std::int64_t, kChannelCount> first_seq_, last_seq_, jumped_to_;
  std::array<History, kChannelCount> history_;
  std::array<std::string, kChannelCount> names_;
  std::vector<Staged> staged_;  // the first staged_count_ are to be sent
  std::size_t staged_count_ = 0;
  BackgroundRate wanted_estimates_{1};
  bool wake_for_all_ = false;
  std::unique_ptr<BusTransport> transport_;
  std::function<void()> new_session_, untagged_request_;
  std::function<void(const SecondSender&)> second_sender_;
  std::function<void(const status_t&)> twin_;
  SenderTable senders_;
  std::optional<Tagger> tagger_;
};

// CLOCK_MONOTONIC.
std::int64_t host_now_ns();
// Fresh session id: not 0, unlikely to meet another.
std::int64_t new_session_id();

template <class Message>
void Bus::subscribe(std::function<void(const Message&)> handler, Wake wake) {
  subscribe_raw(
      kChannelOf<Message>,
      [this, handler = std::move(handler)](Channel, const std::uint8_t* bytes, std::size_t size,
                                           std::int64_t, std::int64_t) {
        Message message;
        if (!decode(message, bytes, size))
          ++counters_.undecodable;
        else
          handler(message);
      },
      wake);
}

template <class Message>
void Bus::stage(Message& message) {
  message.session = session_;
  message.tag = 0;
  if constexpr (requires { message.host_ns; }) message.host_ns = host_now_ns();
  if constexpr (std::is_same_v<Message, request_t>)
    if (message.t_ns == 0) message.t_ns = host_now_ns();  // each sending is another message
  if (staged_.size() == staged_count_) staged_.emplace_back();
  Staged& staged = staged_[staged_count_++];
  staged.channel = kChannelOf<Message>;
  staged.later = false;
  staged.bytes.resize(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(staged.bytes.data(), 0, static_cast<int>(staged.bytes.size()));
  if (tagger_) tagger_->put(name_of(staged.channel), staged.bytes.data(), staged.bytes.size());
  keep(staged.channel, message.seq, staged.bytes);
}

template <class... Message>
void Bus::publish(Message... messages) {
  (stage(messages), ...);
  send_staged();
}

template <class Message>
void Bus::publish_later(Message message) {
  stage(message);
  staged_[staged_count_ - 1].later = true;
  send_staged();
}

}  // namespace twinrate
