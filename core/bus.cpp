#include "core/bus.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <regex.h>

#include <algorithm>
#include <cassert>
#include <chrono>
#include <cstdlib>
#include <numeric>
#include <random>
#include <utility>

#include "core/bus_transport.hpp"
#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "core/message_check.hpp"
#include "core/multicast.hpp"
#include "core/shared_transport.hpp"
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

constexpr int kPortsSplit = 6;

// The match of a pattern and its groups; empty if the text does not match. POSIX, because
// std::regex is slow to compile.
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

// For a malformed URL, LCM itself prints several lines or none.
bool well_formed(const std::string& url) {
  const auto parts =
      match(url,
            "^udpm://([0-9]{1,3})[.]([0-9]{1,3})[.]([0-9]{1,3})[.]([0-9]{1,3}):([0-9]{1,5})"
            "([?](ttl|recv_buf_size)=[0-9]+(&(ttl|recv_buf_size)=[0-9]+)*)?$");
  // No file URLs: liblcm would empty the file that mode=w names.
  if (parts.empty()) return !match(url, "^(mpudpm|tcpq|memq)://").empty();
  const auto number = [&](std::size_t i) { return std::stoi(parts[i]); };
  return number(1) >= 224 && number(1) <= 239 && number(2) <= 255 && number(3) <= 255 &&
         number(4) <= 255 && number(5) >= 1 && number(5) + kPortsSplit <= 65536;
}

constexpr const char* kOptionsOfUrl = "(ttl|recv_buf_size)=([0-9]+)&?(.*)$";

// Of a well-formed udpm URL.
UdpmAddress to_udpm_address(const std::string& url) {
  const auto parts = match(url, "^udpm://([0-9.]+):([0-9]+)[?]?(.*)$");
  UdpmAddress address;
  inet_pton(AF_INET, parts[1].c_str(), &address.group);
  address.port = static_cast<std::uint16_t>(std::stoi(parts[2]));
  for (auto option = match(parts[3], kOptionsOfUrl); !option.empty();
       option = match(option[3], kOptionsOfUrl)) {
    const int number = static_cast<int>(std::min(std::stoll(option[2].substr(0, 10)), 1LL << 30));
    (option[1] == "ttl" ? address.ttl : address.receive_buffer) = number;
  }
  return address;
}

bool is_udpm(const std::string& url) {
  return url.rfind("udpm://", 0) == 0;
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

Bus::Bus(const BusOptions& options)
    : options_(options), session_(options.session), bound_(options.session != 0) {
  check_channel_suffix(options_.channel_suffix);
  options_.url = resolve_url(options_.url);
  const bool udpm = is_udpm(options_.url);
  if (!udpm && options_.split_ports)
    throw BadInput(fmt::format("{}: bus.split_ports needs a URL of the form udpm://ADDRESS:PORT",
                               options_.url));
  if (!udpm && !options_.shared_memory.empty())
    throw BadInput(fmt::format("{}: --shared-memory needs a URL of the form udpm://ADDRESS:PORT",
                               options_.url));
  first_seq_.fill(-1);
  jumped_to_.fill(-1);
  last_seq_.fill(-1);
  for (History& history : history_) history.ring.resize(options_.history);
  for (const ChannelInfo& channel : kChannels)
    names_[static_cast<std::size_t>(channel.channel)] = channel.name + options_.channel_suffix;
  if (udpm && !multicast_route_exists("239.255.76.67"))
    throw MachineError("no multicast route, LCM cannot work; as root: " + multicast_mend());
  transport_ = udpm ? make_udpm_transport(
                          to_udpm_address(options_.url),
                          {.filter = options_.filter,
                           .drain_every_ms = options_.drain_every_ms,
                           .later_cpu = options_.shared_memory.empty() ? options_.later_cpu : -1,
                           .spin_us = options_.spin_us})
                    : make_liblcm_transport(options_.url);
  if (!options_.shared_memory.empty())
    transport_ = make_shared_transport(std::move(transport_), to_udpm_address(options_.url),
                                       {.path = options_.shared_memory,
                                        .role = options_.role,
                                        .drain_every_ms = options_.drain_every_ms,
                                        .watch_cpu = options_.later_cpu});
  tag_with(options_.token_file);
  subscribe<ack_t>([this](const ack_t& ack) { serve_missing(ack); });
}

Bus::~Bus() = default;

void Bus::tag_with(const std::string& token_file) {
  tagger_.reset();
  options_.token_file = token_file;
  if (!token_file.empty()) tagger_.emplace(read_token(token_file));
}

BusCounters Bus::counters() const {
  BusCounters all = counters_;
  all.undecodable += transport_->malformed();
  return all;
}

// Channels on which a process answers received messages.
static bool is_answer(Channel channel) {
  return channel == Channel::kGain || channel == Channel::kStatus || channel == Channel::kEvent ||
         channel == Channel::kReply || channel == Channel::kAck;
}

void Bus::subscribe_raw(Channel channel, RawHandler handler, Wake wake) {
  hears_leaders_ = hears_leaders_ || !is_answer(channel);
  transport_->subscribe(
      wanted(channel), options_.split_ports ? port_offset(channel) : 0, wake == Wake::kQuiet,
      [this, channel, handler = std::move(handler)](const std::uint8_t* bytes, std::size_t size) {
        received(channel, bytes, size, handler);
      });
}

WantedChannel Bus::wanted(Channel channel) const {
  WantedChannel wanted{.name = name_of(channel), .channel = channel};
  // Another set on this URL would wake this process with each of its ticks.
  if (bound_ && channel < Channel::kStatus) wanted.session = session_;
  if (channel != Channel::kEstimate) return wanted;
  wanted.every = static_cast<std::uint32_t>(wanted_estimates_.n);
  wanted.from =
      static_cast<std::uint32_t>(std::min<std::int64_t>(wanted_estimates_.from, UINT32_MAX));
  return wanted;
}

void Bus::want_estimates(BackgroundRate rate) {
  const bool first = wanted_estimates_.n == 1;
  wanted_estimates_ = first ? rate
                            : BackgroundRate{std::gcd(wanted_estimates_.n, rate.n),
                                             std::max(wanted_estimates_.from, rate.from)};
  transport_->change(wanted(Channel::kEstimate));
}

void Bus::subscribe_all(const RawHandler& handler, bool with_acks) {
  for (const ChannelInfo& channel : kChannels)
    if (with_acks || channel.channel != Channel::kAck)
      subscribe_raw(channel.channel, handler, Wake::kAtOnce);
}

// One message of a far future tick would make its receiver deaf for those in between. A GAIN is
// counted in gains.
bool Bus::jumps(Channel channel, std::int64_t seq) {
  const bool gain = channel == Channel::kGain;
  if (options_.max_jump <= 0 || channel >= Channel::kStatus || (gain && !options_.gains_between))
    return false;
  const auto far = [&](std::int64_t from, std::int64_t most) {
    return (gain ? options_.gains_between(from, seq) : seq - from) > most;
  };
  const std::int64_t most =
      options_.max_jump + (channel == Channel::kEstimate ? 2 * wanted_estimates_.n : 0);
  const std::int64_t last = last_seq_[static_cast<std::size_t>(channel)];
  const std::int64_t before =
      std::exchange(jumped_to_[static_cast<std::size_t>(channel)], std::int64_t{-1});
  if (last < 0 || seq <= last || !far(last, most)) return false;
  if (before >= 0 && seq > before && !far(before, most)) return false;
  jumped_to_[static_cast<std::size_t>(channel)] = seq;
  return true;
}

bool Bus::admit(Channel channel, std::int64_t seq, std::int64_t session) {
  if (channel < Channel::kStatus && seq >= options_.ticks) {
    ++counters_.refused;
    return false;
  }
  if (session == session_ && jumps(channel, seq)) {
    ++counters_.refused;
    return false;
  }
  if (session == session_) return true;
  // Session 0 is a speaker that has no session yet: nothing to take over. An answer may be of the
  // session before, sent by a process that has not heard of the new one.
  const bool begins = session_ == 0 || (options_.follow && !(hears_leaders_ && is_answer(channel)));
  if (!bound_ && session != 0 && begins) {
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

// True if the message has a valid tag, or if tags are not required.
bool Bus::is_genuine(Channel channel, const std::uint8_t* bytes, std::size_t size) {
  if (!checks_tags() || tagger_->is_genuine(name_of(channel), bytes, size)) return true;
  ++counters_.refused;
  if (channel == Channel::kRequest && untagged_request_ && big_endian_64(bytes + 24) == session_)
    untagged_request_();
  return false;
}

// The tag shows that the sender has the token, the socket which one of those it is.
bool Bus::is_of_its_sender(Channel channel, const std::uint8_t* bytes, std::size_t size) {
  const SocketName socket = transport_->sender();
  if (!bound_ || socket == 0) return true;
  const int role = role_of(channel, bytes);
  if (twin_ && channel == Channel::kStatus && role == static_cast<int>(options_.role) &&
      !transport_->is_own(socket))
    if (status_t status; decode(status, bytes, size)) twin_(status);
  if (!checks_tags() || senders_.admits(channel, bytes, socket)) return true;
  ++counters_.refused;
  if (second_sender_) second_sender_({channel, role, socket});
  return false;
}

SocketName Bus::sender() const {
  return transport_->sender();
}

bool Bus::is_from(Role role) const {
  const SocketName socket = transport_->sender();
  if (!bound_ || !checks_tags() || socket == 0) return true;
  return transport_->is_own(socket) ? options_.role == role : senders_.is(role, socket);
}

// Messages between two of a channel that are missing.
std::int64_t Bus::gap(Channel channel, std::int64_t last, std::int64_t seq) const {
  if (channel == Channel::kGain)
    return options_.gains_between ? options_.gains_between(last, seq) - 1 : 0;
  if (channel == Channel::kEstimate)
    return snapshots_up_to(seq - 1, wanted_estimates_) - snapshots_up_to(last, wanted_estimates_);
  return seq - last - 1;
}

// A repeated message has an older number. An unbound bus that receives the first number again is
// playing a log from its start.
void Bus::count_gap(Channel channel, std::int64_t seq) {
  std::int64_t& first = first_seq_[static_cast<std::size_t>(channel)];
  std::int64_t& last = last_seq_[static_cast<std::size_t>(channel)];
  if (last < 0 || (!bound_ && seq <= first)) {
    first = last = seq;
  } else if (seq > last) {
    counters_.gaps += gap(channel, last, seq);
    last = seq;
  }
}

void Bus::received(Channel channel, const std::uint8_t* bytes, std::size_t size,
                   const RawHandler& handler) {
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
  if (!is_genuine(channel, bytes, size)) return;
  std::int64_t seq = 0, t_ns = 0;
  const std::int64_t session = big_endian_64(bytes + 24);
  const bool foreign = bound_ && session != session_;  // always refused
  if (!foreign && !is_whole_message(channel, bytes, size, seq, t_ns)) {
    ++counters_.undecodable;
    return;
  }
  if (!foreign && !is_of_its_sender(channel, bytes, size)) return;
  if (!admit(channel, seq, session)) return;
  if (channel < Channel::kStatus) count_gap(channel, seq);
  handler(channel, bytes, size, seq, t_ns);
}

void Bus::keep(Channel channel, std::int64_t seq, const std::vector<std::uint8_t>& bytes) {
  if (seq < 0 || channel >= Channel::kStatus) return;
  History& history = history_[static_cast<std::size_t>(channel)];
  Kept& kept = history.ring[history.next];
  history.next = (history.next + 1) % history.ring.size();
  kept.seq = seq;
  kept.bytes = bytes;
}

void Bus::send_staged() {
  std::array<BusTransport::Outgoing, 4> list{};
  assert(staged_count_ <= list.size());
  for (std::size_t i = 0; i < staged_count_; ++i)
    list[i] = {&name_of(staged_[i].channel),
               staged_[i].bytes.data(),
               staged_[i].bytes.size(),
               options_.split_ports ? port_offset(staged_[i].channel) : 0,
               staged_[i].later,
               staged_[i].channel};
  transport_->send(list.data(), std::exchange(staged_count_, 0));
}

bool Bus::send_again(Channel channel, std::int64_t seq) {
  const History& history = history_[static_cast<std::size_t>(channel)];
  for (const Kept& kept : history.ring) {
    if (kept.seq != seq) continue;
    const BusTransport::Outgoing message = {&name_of(channel),
                                            kept.bytes.data(),
                                            kept.bytes.size(),
                                            options_.split_ports ? port_offset(channel) : 0,
                                            false,
                                            channel};
    transport_->send(&message, 1);
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
  return transport_->handle(timeout_ms, wake_for_all_);
}

std::int64_t Bus::arrival_us() const {
  return transport_->arrival_us();
}

std::int64_t host_now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

std::int64_t new_session_id() {
  std::random_device device;
  const auto now =
      static_cast<std::uint64_t>(std::chrono::system_clock::now().time_since_epoch().count());
  const std::uint64_t id = splitmix64(now ^ (static_cast<std::uint64_t>(device()) << 32));
  return static_cast<std::int64_t>(id >> 1 | 1);
}

}  // namespace twinrate
