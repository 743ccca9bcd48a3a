#include "core/bus.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <regex.h>

#include <cassert>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <random>
#include <set>
#include <utility>

#include "core/channel_filter.hpp"
#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "core/message_check.hpp"
#include "core/multicast.hpp"
#include "model/random.hpp"

namespace twinrate {
namespace {

std::int64_t big_endian_64(const std::uint8_t* bytes) {
  std::uint64_t value = 0;
  for (int i = 0; i < 8; ++i) value = value << 8 | bytes[i];
  return static_cast<std::int64_t>(value);
}

// Every message begins: fingerprint, seq, t_ns, session, 8 bytes each.
constexpr std::size_t kHeaderSize = 32;

// A receive buffer large enough that a burst is not lost while this process waits for its turn.
std::string with_receive_buffer(const std::string& url) {
  if (url.rfind("udpm://", 0) != 0 || url.find("recv_buf_size") != std::string::npos) return url;
  return url + (url.find('?') == std::string::npos ? "?" : "&") + "recv_buf_size=4194304";
}

constexpr const char* kUdpmUrl = "^(udpm://[^:/?]+):([0-9]+)(.*)$";
constexpr int kPortsSplit = 6;

// The matches of a pattern and its groups; empty where it does not match. POSIX, because std::regex
// is slow to compile.
std::vector<std::string> match(const std::string& text, const char* pattern) {
  regex_t regex;
  const int compiled = regcomp(&regex, pattern, REG_EXTENDED);
  assert(compiled == 0);
  std::vector<regmatch_t> parts(regex.re_nsub + 1);
  std::vector<std::string> found;
  if (regexec(&regex, text.c_str(), parts.size(), parts.data(), 0) == 0)
    for (const regmatch_t& p : parts)
      found.push_back(p.rm_so < 0 ? "" : text.substr(p.rm_so, p.rm_eo - p.rm_so));
  regfree(&regex);
  return found;
}

// LCM itself prints several lines, or none, where a URL is malformed.
bool well_formed(const std::string& url) {
  const auto parts =
      match(url,
            "^udpm://([0-9]{1,3})[.]([0-9]{1,3})[.]([0-9]{1,3})[.]([0-9]{1,3}):([0-9]{1,5})"
            "([?](ttl|recv_buf_size)=[0-9]+(&(ttl|recv_buf_size)=[0-9]+)*)?$");
  if (parts.empty()) return !match(url, "^(mpudpm|tcpq|memq|file)://").empty();
  const auto number = [&](std::size_t i) { return std::stoi(parts[i]); };
  return number(1) >= 224 && number(1) <= 239 && number(2) <= 255 && number(3) <= 255 &&
         number(4) <= 255 && number(5) >= 1 && number(5) + kPortsSplit <= 65536;
}

// 0 for a URL of another kind.
std::uint16_t port_of(const std::string& url) {
  const auto parts = match(url, kUdpmUrl);
  return parts.empty() ? 0 : static_cast<std::uint16_t>(std::stoi(parts[2]));
}

std::string with_port_offset(const std::string& url, int offset) {
  if (offset == 0) return url;
  const auto parts = match(url, kUdpmUrl);
  if (parts.empty())
    throw BadInput(
        fmt::format("{}: bus.split_ports needs a URL of the form udpm://ADDRESS:PORT", url));
  return fmt::format("{}:{}{}", parts[1], std::stoi(parts[2]) + offset, parts[3]);
}

// With split ports: the four links of the ring on ports of their own, everything else on the first
// one.
int port_offset(Channel channel) {
  switch (channel) {
    case Channel::kMeasurement:
      return 1;
    case Channel::kEstimate:
      return 2;
    case Channel::kCommand:
      return 3;
    case Channel::kGain:
      return 4;
    case Channel::kTruth:
    case Channel::kReference:
      return 5;
    default:
      return 0;
  }
}

}  // namespace

std::string resolve_url(const std::string& wanted) {
  const char* from_environment = std::getenv("LCM_DEFAULT_URL");
  const std::string url = !wanted.empty()                         ? wanted
                          : from_environment && *from_environment ? from_environment
                                                                  : kDefaultUrl;
  if (!well_formed(url))
    throw BadInput(fmt::format(
        "{} {}: a URL such as {} allowed: a multicast address, a port, ?ttl= and recv_buf_size=",
        wanted.empty() ? "LCM_DEFAULT_URL" : "--lcm-url", url, kDefaultUrl));
  return url;
}

void check_channel_suffix(const std::string& suffix) {
  if (match(suffix, "^[A-Za-z0-9_]{0,32}$").empty())
    throw BadInput(
        fmt::format("--channel-suffix {}: up to 32 letters, digits and _ allowed", suffix));
}

struct Bus::Link {
  struct Subscription {
    Bus* bus;
    Channel channel;
    RawHandler handler;
    void receive(const lcm::ReceiveBuffer* buffer, const std::string&) {
      bus->received(channel, buffer, handler);
    }
  };
  explicit Link(const std::string& url) : lcm(url) {}
  // The socket appears with the first subscription.
  void filter_by_channel(std::uint16_t port, const std::string& suffix) {
    if (socket < 0) {
      for (int candidate : udp_sockets_on(port))
        if (!before.count(candidate)) socket = candidate;
    }
    std::vector<std::string> names;
    for (const auto& s : subscriptions) names.push_back(info(s->channel).name + suffix);
    if (socket >= 0) filter_channels(socket, names);
  }
  lcm::LCM lcm;
  std::vector<std::unique_ptr<Subscription>> subscriptions;
  std::set<int> before;  // sockets on this port that belong to others
  int socket = -1;
};

Bus::Bus(const BusOptions& options)
    : options_(options), session_(options.session), bound_(options.session != 0) {
  check_channel_suffix(options_.channel_suffix);
  options_.url = resolve_url(options_.url);
  first_seq_.fill(-1);
  last_seq_.fill(-1);
  for (History& history : history_) history.ring.resize(options_.history);
  if (options_.url.rfind("udpm://", 0) == 0 && !multicast_route_exists("239.255.76.67"))
    throw MachineError("no multicast route, LCM cannot work; as root: " + multicast_mend());
  link(Channel::kStatus);
  subscribe<ack_t>([this](const ack_t& ack) { serve_missing(ack); });
}

Bus::~Bus() = default;

lcm::LCM& Bus::link(Channel channel) {
  const int offset = options_.split_ports ? port_offset(channel) : 0;
  auto& slot = links_[offset];
  if (!slot) {
    slot = std::make_unique<Link>(with_receive_buffer(with_port_offset(options_.url, offset)));
    if (!slot->lcm.good())
      throw MachineError(
          fmt::format("{}: LCM cannot open this URL; try twinrate doctor", options_.url));
  }
  return slot->lcm;
}

std::string Bus::name_of(Channel channel) const {
  return info(channel).name + options_.channel_suffix;
}

void Bus::subscribe_raw(Channel channel, RawHandler handler) {
  lcm::LCM& instance = link(channel);
  Link& owner = *links_[options_.split_ports ? port_offset(channel) : 0];
  const std::uint16_t port =
      port_of(with_port_offset(options_.url, options_.split_ports ? port_offset(channel) : 0));
  if (owner.subscriptions.empty()) owner.before = udp_sockets_on(port);
  owner.subscriptions.push_back(
      std::make_unique<Link::Subscription>(Link::Subscription{this, channel, std::move(handler)}));
  lcm::Subscription* subscription = instance.subscribe(
      name_of(channel), &Link::Subscription::receive, owner.subscriptions.back().get());
  // The first subscription runs LCM's self-test; where it fails the instance must not be used.
  if (!subscription || !instance.good() || instance.getFileno() < 0)
    throw MachineError("the LCM self-test failed; as root: " + multicast_mend());
  subscription->setQueueCapacity(0);  // unbounded: a full queue would drop the newest message
  if (options_.filter && port != 0) owner.filter_by_channel(port, options_.channel_suffix);
}

void Bus::subscribe_all(const RawHandler& handler) {
  for (const ChannelInfo& channel : kChannels)
    if (channel.channel != Channel::kAck) subscribe_raw(channel.channel, handler);
}

bool Bus::admit(Channel channel, std::int64_t seq, std::int64_t session) {
  if (channel < Channel::kStatus && seq >= options_.ticks) {
    ++counters_.refused;
    return false;
  }
  if (session == session_) return true;
  // Session 0 is a speaker that has no session yet: nothing to take over.
  if (!bound_ && session != 0 && (session_ == 0 || options_.follow)) {
    const bool changed = session_ != 0;
    session_ = session;
    first_seq_.fill(-1);
    last_seq_.fill(-1);
    if (changed && new_session_) new_session_();
    return true;
  }
  ++counters_.refused;
  return false;
}

// A repeated message has an older number. Only where an unbound bus receives the first number again
// has a log been started anew.
void Bus::count_gap(Channel channel, std::int64_t seq) {
  std::int64_t& first = first_seq_[static_cast<std::size_t>(channel)];
  std::int64_t& last = last_seq_[static_cast<std::size_t>(channel)];
  if (last < 0 || (!bound_ && seq <= first)) {
    first = last = seq;
  } else if (seq > last) {
    if (channel != Channel::kGain)
      counters_.gaps += seq - last - 1;
    else if (options_.gains_between)
      counters_.gaps += options_.gains_between(last, seq) - 1;
    last = seq;
  }
}

void Bus::received(Channel channel, const lcm::ReceiveBuffer* buffer, const RawHandler& handler) {
  const auto* bytes = static_cast<const std::uint8_t*>(buffer->data);
  const std::size_t size = buffer->data_size;
  if (size < kHeaderSize) {
    ++counters_.undecodable;
    return;
  }
  if (options_.drop_rate > 0 &&
      uniform(static_cast<std::uint64_t>(session_), static_cast<std::uint64_t>(options_.role),
              datagrams_seen_++) < options_.drop_rate) {
    ++counters_.dropped_on_purpose;
    return;
  }
  std::int64_t seq = 0, t_ns = 0;
  const std::int64_t session = big_endian_64(bytes + 24);
  const bool foreign = bound_ && session != session_;  // refused whatever it is
  if (!foreign && !is_whole_message(channel, bytes, size, seq, t_ns)) {
    ++counters_.undecodable;
    return;
  }
  if (!admit(channel, seq, session)) return;
  if (channel < Channel::kStatus) count_gap(channel, seq);
  try {
    handler(channel, bytes, size, seq, t_ns);
  } catch (...) {
    thrown_ = std::current_exception();
  }
}

void Bus::send(Channel channel, std::int64_t seq, const std::uint8_t* bytes, std::size_t size) {
  if (seq >= 0 && channel < Channel::kStatus) {
    History& history = history_[static_cast<std::size_t>(channel)];
    Kept& kept = history.ring[history.next];
    history.next = (history.next + 1) % history.ring.size();
    kept.seq = seq;
    kept.bytes.assign(bytes, bytes + size);
  }
  link(channel).publish(name_of(channel), bytes, static_cast<unsigned>(size));
}

bool Bus::send_again(Channel channel, std::int64_t seq) {
  const History& history = history_[static_cast<std::size_t>(channel)];
  for (const Kept& kept : history.ring) {
    if (kept.seq != seq) continue;
    link(channel).publish(name_of(channel), kept.bytes.data(),
                          static_cast<unsigned>(kept.bytes.size()));
    ++counters_.resent;
    return true;
  }
  return false;
}

void Bus::serve_missing(const ack_t& ack) {
  for (int i = 0; i < ack.n_missing && i < 32; ++i) {
    const int channel = ack.missing_channel[i];
    if (channel >= 0 && channel < static_cast<int>(Channel::kStatus))
      send_again(static_cast<Channel>(channel), ack.missing_seq[i]);
  }
}

bool Bus::handle(double timeout_ms) {
  std::array<pollfd, 8> descriptors{};
  std::size_t count = 0;
  for (auto& [offset, link] : links_)
    if (!link->subscriptions.empty())
      descriptors[count++] = {.fd = link->lcm.getFileno(), .events = POLLIN, .revents = 0};
  const auto whole_s = static_cast<time_t>(timeout_ms / 1000);
  const timespec timeout{
      .tv_sec = whole_s,
      .tv_nsec = static_cast<long>((timeout_ms - 1000.0 * static_cast<double>(whole_s)) * 1e6)};
  const int ready = ppoll(descriptors.data(), count, &timeout, nullptr);
  if (ready <= 0) return false;  // time-out, or a signal: the caller looks at its stop flag
  std::size_t index = 0;
  for (auto& [offset, link] : links_) {
    if (link->subscriptions.empty()) continue;
    if (descriptors[index++].revents & POLLIN) link->lcm.handle();
    if (thrown_) std::rethrow_exception(std::exchange(thrown_, nullptr));
  }
  return true;
}

std::int64_t new_session_id() {
  std::random_device device;
  const auto now =
      static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch().count());
  const std::uint64_t id = splitmix64(now ^ (static_cast<std::uint64_t>(device()) << 32));
  return static_cast<std::int64_t>(id >> 1 | 1);
}

}  // namespace twinrate
