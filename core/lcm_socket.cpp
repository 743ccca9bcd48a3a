#include "core/lcm_socket.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <poll.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "core/machine_error.hpp"

namespace twinrate {
namespace {

// A datagram is at most 65507 bytes; pages of a buffer that no datagram reaches are never touched.
constexpr std::size_t kBuffer = 65536;
constexpr std::size_t kOnePart = 2048;  // channel and message that are copied together to be sent

[[noreturn]] void fail(const char* what) {
  throw MachineError(
      fmt::format("multicast: {}: {}; try twinrate doctor", what, std::strerror(errno)));
}

template <class Option>
void set(int socket, int level, int name, const Option& option, const char* what) {
  if (setsockopt(socket, level, name, &option, sizeof option) != 0) fail(what);
}

sockaddr_in to_sockaddr(const UdpmAddress& address) {
  sockaddr_in in{};
  in.sin_family = AF_INET;
  in.sin_port = htons(address.port);
  in.sin_addr.s_addr = address.group;
  return in;
}

std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC_COARSE, &t);
  return t.tv_sec * std::int64_t{1'000'000'000} + t.tv_nsec;
}

std::uint64_t name_of(const sockaddr_in& address) {
  return std::uint64_t{address.sin_addr.s_addr} << 16 | std::uint64_t{address.sin_port};
}

sockaddr_in address_of(int socket) {
  sockaddr_in own{};
  socklen_t size = sizeof own;
  getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size);
  return own;
}

// Source address of datagrams to `to`. Throws MachineError if there is no route.
sockaddr_in address_towards(const sockaddr_in& to) {
  const FileDescriptor probe(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (connect(probe.get(), reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0)
    fail("no route");
  return address_of(probe.get());
}

iovec part(const void* bytes, std::size_t size) {
  return {.iov_base = const_cast<void*>(bytes), .iov_len = size};
}

}  // namespace

FileDescriptor::~FileDescriptor() {
  if (fd_ >= 0) close(fd_);
}

// The socket is not connected: Linux would then send to the interface with the socket's address
// instead of the one of the route to the group.
LcmSender::LcmSender(const UdpmAddress& address)
    : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)), to_(to_sockaddr(address)) {
  if (socket_.get() < 0) fail("socket");
  set(socket_.get(), IPPROTO_IP, IP_MULTICAST_TTL, static_cast<std::uint8_t>(address.ttl), "ttl");
  set(socket_.get(), IPPROTO_IP, IP_MULTICAST_LOOP, std::uint8_t{1}, "loop");
  const sockaddr_in any_port{.sin_family = AF_INET, .sin_port = 0, .sin_addr = {}, .sin_zero = {}};
  if (bind(socket_.get(), reinterpret_cast<const sockaddr*>(&any_port), sizeof any_port) != 0)
    fail("port");
  sockaddr_in own = address_towards(to_);
  own.sin_port = address_of(socket_.get()).sin_port;
  name_ = name_of(own);
}

void LcmSender::send(const std::string& channel, const std::uint8_t* bytes, std::size_t size) {
  Datagrams datagrams(channel, bytes, size, sequence_++);
  while (datagrams.next()) {
    std::array<iovec, 3> parts = {
        part(datagrams.header(), datagrams.header_size()),
        part(channel.c_str(), datagrams.names_channel() ? channel.size() + 1 : 0),
        part(datagrams.payload(), datagrams.payload_size())};
    msghdr message{};
    message.msg_name = &to_;
    message.msg_namelen = sizeof to_;
    message.msg_iov = parts.data();
    message.msg_iovlen = parts.size();
    while (sendmsg(socket_.get(), &message, 0) < 0 && errno == EINTR) {
    }
  }
}

// One part costs the kernel less than three.
void LcmSender::send_whole(const Small& m) {
  Datagrams datagram(*m.channel, m.bytes, m.size, sequence_++);
  datagram.next();
  std::array<std::uint8_t, kWholeHeader + kOnePart> bytes;
  std::uint8_t* end = std::copy_n(datagram.header(), kWholeHeader, bytes.data());
  end = std::copy_n(m.channel->c_str(), m.channel->size() + 1, end);
  end = std::copy_n(m.bytes, m.size, end);
  while (sendto(socket_.get(), bytes.data(), static_cast<std::size_t>(end - bytes.data()), 0,
                reinterpret_cast<const sockaddr*>(&to_), sizeof to_) < 0 &&
         errno == EINTR) {
  }
}

void LcmSender::send_together(const Small* messages, std::size_t count) {
  if (count == 1 && messages->channel->size() + 1 + messages->size <= kOnePart)
    return send_whole(*messages);
  bool small = count <= kMostTogether;
  for (std::size_t i = 0; small && i < count; ++i) {
    const Small& m = messages[i];
    small = m.channel->size() + 1 + m.size <= kMaxWhole;
    Datagrams datagram(*m.channel, m.bytes, m.size, sequence_ + static_cast<std::uint32_t>(i));
    if (!small || !datagram.next()) break;
    auto& [header, parts] = datagrams_[i];
    std::copy_n(datagram.header(), kWholeHeader, header.begin());
    parts = {part(header.data(), kWholeHeader), part(m.channel->c_str(), m.channel->size() + 1),
             part(m.bytes, m.size)};
    list_[i].msg_hdr.msg_name = &to_;
    list_[i].msg_hdr.msg_namelen = sizeof to_;
    list_[i].msg_hdr.msg_iov = parts.data();
    list_[i].msg_hdr.msg_iovlen = parts.size();
  }
  if (!small) {
    for (std::size_t i = 0; i < count; ++i)
      send(*messages[i].channel, messages[i].bytes, messages[i].size);
    return;
  }
  sequence_ += static_cast<std::uint32_t>(count);
  for (std::size_t sent = 0; sent < count;) {
    const int now = sendmmsg(socket_.get(), &list_[sent], static_cast<unsigned>(count - sent), 0);
    if (now > 0)
      sent += static_cast<std::size_t>(now);
    else if (errno != EINTR)
      ++sent;
  }
}

LcmReceiver::LcmReceiver(const UdpmAddress& address, std::size_t batch, bool stamped)
    : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)),
      batch_(batch),
      buffers_(new std::uint8_t[batch * kBuffer]),
      parts_(batch),
      senders_(batch),
      headers_(batch),
      stamps_(stamped ? batch : 0) {
  if (socket_.get() < 0) fail("socket");
  if (stamped) set(socket_.get(), SOL_SOCKET, SO_TIMESTAMPNS, 1, "time stamps");
  set(socket_.get(), SOL_SOCKET, SO_REUSEADDR, 1, "port shared");
  // Beyond net.core.rmem_max with CAP_NET_ADMIN.
  for (const int option : {SO_RCVBUFFORCE, SO_RCVBUF})
    if (setsockopt(socket_.get(), SOL_SOCKET, option, &address.receive_buffer,
                   sizeof address.receive_buffer) == 0)
      break;
  socklen_t size = sizeof granted_buffer_;
  getsockopt(socket_.get(), SOL_SOCKET, SO_RCVBUF, &granted_buffer_, &size);
  // Bound to the group: datagrams of other groups on this port do not arrive.
  const sockaddr_in at = to_sockaddr(address);
  if (bind(socket_.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at) != 0) fail("bind");
  ip_mreq group{};
  group.imr_multiaddr.s_addr = address.group;
  group.imr_interface.s_addr = htonl(INADDR_ANY);
  set(socket_.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, group, "joining the group");
  for (std::size_t i = 0; i < batch_; ++i) {
    parts_[i] = part(buffers_.get() + i * kBuffer, kBuffer);
    headers_[i].msg_hdr.msg_iov = &parts_[i];
    headers_[i].msg_hdr.msg_iovlen = 1;
    headers_[i].msg_hdr.msg_name = &senders_[i];
  }
}

bool LcmReceiver::read(std::size_t most, int flags) {
  next_ = count_ = 0;
  if (most == 1 && stamps_.empty()) return read_one(flags);
  for (std::size_t i = 0; i < most; ++i) headers_[i].msg_hdr.msg_namelen = sizeof(sockaddr_in);
  for (std::size_t i = 0; i < std::min(most, stamps_.size()); ++i) {
    headers_[i].msg_hdr.msg_control = stamps_[i].bytes.data();
    headers_[i].msg_hdr.msg_controllen = stamps_[i].bytes.size();
  }
  const int got =
      recvmmsg(socket_.get(), headers_.data(), static_cast<unsigned>(most), flags, nullptr);
  if (got <= 0) return false;  // nothing there, or a signal: the caller looks at its stop flag
  count_ = static_cast<std::size_t>(got);
  return true;
}

// Costs the kernel less than a list of one.
bool LcmReceiver::read_one(int flags) {
  socklen_t size = sizeof senders_[0];
  const ssize_t got = recvfrom(socket_.get(), buffers_.get(), kBuffer, flags,
                               reinterpret_cast<sockaddr*>(senders_.data()), &size);
  if (got < 0) return false;  // as below
  headers_[0].msg_len = static_cast<unsigned>(got);
  count_ = 1;
  return true;
}

bool LcmReceiver::read_now() {
  return read(batch_, MSG_DONTWAIT);
}

bool LcmReceiver::read_waiting(double timeout_ms) {
  if (timeout_ms != timeout_ms_) {
    const auto us = static_cast<std::int64_t>(timeout_ms * 1e3);
    const timeval limit{.tv_sec = us / 1'000'000, .tv_usec = us % 1'000'000};
    set(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, limit, "time-out");
    timeout_ms_ = timeout_ms;
  }
  return read(1, 0);
}

std::int64_t LcmReceiver::arrival_us(std::size_t i) const {
  if (stamps_.empty()) return 0;
  const cmsghdr* stamp = CMSG_FIRSTHDR(&headers_[i].msg_hdr);
  if (!stamp || stamp->cmsg_level != SOL_SOCKET || stamp->cmsg_type != SCM_TIMESTAMPNS) return 0;
  timespec t{};
  std::memcpy(&t, CMSG_DATA(stamp), sizeof t);
  return t.tv_sec * std::int64_t{1'000'000} + t.tv_nsec / 1000;
}

bool LcmReceiver::next(LcmMessage& message) {
  while (next_ < count_) {
    const std::size_t i = next_++;
    const sockaddr_in& from = senders_[i];
    const std::uint64_t sender = name_of(from);
    switch (reassembly_.take(buffers_.get() + i * kBuffer, headers_[i].msg_len, sender, now_ns(),
                             message)) {
      case Reassembly::Outcome::kWhole:
        message.arrival_us = arrival_us(i);
        message.sender = sender;
        return true;
      case Reassembly::Outcome::kMalformed:
        ++malformed_;
        break;
      case Reassembly::Outcome::kPart:
        break;
    }
  }
  return false;
}

bool multicast_is_heard(const UdpmAddress& address) {
  static const std::string kChannel = "LCM_SELF_TEST";
  constexpr std::int64_t kPatience_ns = 1'000'000'000;
  LcmReceiver receiver(address, 16);
  LcmSender sender(address);
  const std::int64_t begun = now_ns();
  sender.send(kChannel, nullptr, 0);
  while (now_ns() - begun < kPatience_ns) {
    receiver.read_waiting(100);
    for (LcmMessage message; receiver.next(message);)
      if (message.channel == kChannel) return true;
  }
  return false;
}

}  // namespace twinrate
