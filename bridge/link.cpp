#include "bridge/link.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <netdb.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>

#include "core/config.hpp"
#include "core/machine_error.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const std::string& what) {
  throw MachineError(fmt::format("{}: {}", what, std::strerror(errno)));
}

struct Speed {
  int baud;
  speed_t code;
};
constexpr Speed kSpeeds[] = {{9600, B9600},       {19200, B19200},     {38400, B38400},
                             {57600, B57600},     {115200, B115200},   {230400, B230400},
                             {460800, B460800},   {500000, B500000},   {576000, B576000},
                             {921600, B921600},   {1000000, B1000000}, {1500000, B1500000},
                             {2000000, B2000000}, {2500000, B2500000}, {3000000, B3000000},
                             {3500000, B3500000}, {4000000, B4000000}};

speed_t speed_code(int baud) {
  for (const Speed& speed : kSpeeds)
    if (speed.baud == baud) return speed.code;
  std::string allowed;
  for (const Speed& speed : kSpeeds) allowed += fmt::format(" {}", speed.baud);
  throw BadInput(fmt::format("bridge.baud: one of{} allowed, found {}", allowed, baud));
}

void make_raw(int fd, int baud, const std::string& name) {
  termios t{};
  if (tcgetattr(fd, &t) != 0) fail(name);
  cfmakeraw(&t);
  t.c_cflag |= CLOCAL | CREAD;
  t.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | CSTOPB | PARENB);
  if (cfsetspeed(&t, speed_code(baud)) != 0 || tcsetattr(fd, TCSANOW, &t) != 0) fail(name);
  tcflush(fd, TCIOFLUSH);
}

class SerialLink final : public Link {
 public:
  explicit SerialLink(int fd) : Link(fd) {}
  ~SerialLink() override { close(fd_); }

 private:
  std::int64_t read_some(std::uint8_t* to, std::size_t size) override {
    return read(fd_, to, size);
  }
  std::int64_t write_some(const std::uint8_t* from, std::size_t size) override {
    return write(fd_, from, size);
  }
};

// The emulator's end of a pty. The other end is held open too, so that a host may come and go.
class PtyLink final : public Link {
 public:
  PtyLink(int fd, int other, fs::path path)
      : Link(fd, 1 << 20), other_(other), path_(std::move(path)) {}
  ~PtyLink() override {
    close(fd_);
    close(other_);
    std::error_code ignored;
    fs::remove(path_, ignored);
  }

 private:
  std::int64_t read_some(std::uint8_t* to, std::size_t size) override {
    return read(fd_, to, size);
  }
  std::int64_t write_some(const std::uint8_t* from, std::size_t size) override {
    return write(fd_, from, size);
  }
  int other_;
  fs::path path_;
};

class UdpLink final : public Link {
 public:
  // `peer` empty: that of the last datagram received.
  UdpLink(int fd, const sockaddr_in* peer) : Link(fd), fixed_(peer != nullptr) {
    if (peer) peer_ = *peer;
  }
  ~UdpLink() override { close(fd_); }

 private:
  std::int64_t read_some(std::uint8_t* to, std::size_t size) override {
    sockaddr_in from{};
    socklen_t length = sizeof from;
    const auto got = recvfrom(fd_, to, size, 0, reinterpret_cast<sockaddr*>(&from), &length);
    // A closed port at the other end is no end of the line: the drive may start later.
    if (got < 0 && errno == ECONNREFUSED) errno = EAGAIN;
    if (got > 0 && !fixed_) peer_ = from;
    return got;
  }
  std::int64_t write_some(const std::uint8_t* from, std::size_t size) override {
    if (peer_.sin_port == 0) return static_cast<std::int64_t>(size);  // no message has arrived yet
    const auto sent =
        sendto(fd_, from, size, 0, reinterpret_cast<const sockaddr*>(&peer_), sizeof peer_);
    if (sent < 0 && errno == ECONNREFUSED) errno = EAGAIN;
    return sent;
  }
  bool fixed_;
  sockaddr_in peer_{};
};

sockaddr_in address_of(const std::string& host_port) {
  const auto colon = host_port.rfind(':');
  int port = 0;
  if (colon != std::string::npos)
    std::from_chars(host_port.data() + colon + 1, host_port.data() + host_port.size(), port);
  if (colon == std::string::npos || port < 1 || port > 65535)
    throw BadInput(fmt::format("{}: HOST:PORT allowed, PORT from 1 to 65535", host_port));
  addrinfo hints{}, *found = nullptr;
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  if (getaddrinfo(host_port.substr(0, colon).c_str(), nullptr, &hints, &found) != 0)
    throw MachineError(fmt::format("{}: no such host", host_port.substr(0, colon)));
  sockaddr_in address{};
  std::memcpy(&address, found->ai_addr, sizeof address);
  freeaddrinfo(found);
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  return address;
}

int udp_socket() {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (fd < 0) fail("UDP socket");
  const int buffer = 1 << 20;  // the granted size suffices: at most 0.1 s of frames wait
  setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer);
  return fd;
}

std::unique_ptr<Link> open_serial(const std::string& port, int baud) {
  const int fd = open(port.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) fail(port);
  auto link = std::make_unique<SerialLink>(fd);  // closes it if a later step fails
  if (!isatty(fd)) throw BadInput(port + ": no serial line");
  if (flock(fd, LOCK_EX | LOCK_NB) != 0)
    throw MachineError(port +
                       ": another process has this line; two hosts must not drive one motor");
  make_raw(fd, baud, port);
  return link;
}

}  // namespace

std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * std::int64_t{1'000'000'000} + t.tv_nsec;
}

std::span<const std::uint8_t> Link::receive(double timeout_ms) {
  constexpr std::size_t kAtOnce = 65536;
  bytes_.resize(kAtOnce);
  if (!flush()) timeout_ms = std::min(timeout_ms, 0.2);  // the other end may read meanwhile
  pollfd wait{fd_, POLLIN, 0};
  const auto ns = static_cast<std::int64_t>(timeout_ms * 1e6);
  const timespec timeout{ns / 1'000'000'000, ns % 1'000'000'000};
  if (ppoll(&wait, 1, &timeout, nullptr) <= 0) return {};
  std::size_t size = 0;
  while (size < kAtOnce) {  // a datagram at a time
    const std::int64_t got = read_some(bytes_.data() + size, kAtOnce - size);
    if (got > 0) {
      size += static_cast<std::size_t>(got);
      continue;
    }
    if (got == 0 || (errno != EAGAIN && errno != EINTR)) open_ = false;
    break;
  }
  return {bytes_.data(), size};
}

void Link::send(std::span<const std::uint8_t> bytes) {
  if (bytes.empty() || !open_) return;
  if (flush()) {
    const std::int64_t sent = write_some(bytes.data(), bytes.size());
    if (sent < 0 && errno != EAGAIN && errno != EINTR && errno != ENOBUFS) open_ = false;
    bytes = bytes.subspan(static_cast<std::size_t>(std::max<std::int64_t>(sent, 0)));
  }
  if (kept_.size() + bytes.size() <= keeps_)
    kept_.insert(kept_.end(), bytes.begin(), bytes.end());
  else if (!bytes.empty())
    ++unsent_;
}

// True if nothing is buffered any more.
bool Link::flush() {
  if (kept_.empty()) return true;
  const std::int64_t sent = write_some(kept_.data(), kept_.size());
  if (sent > 0) kept_.erase(kept_.begin(), kept_.begin() + sent);
  return kept_.empty();
}

std::unique_ptr<Link> open_link(const std::string& port, int baud) {
  const std::string udp = "udp://";
  if (port.empty())
    throw BadInput("bridge.port: a serial device or udp://HOST:PORT required, found nothing");
  if (!port.starts_with(udp)) return open_serial(port, baud);
  const sockaddr_in peer = address_of(port.substr(udp.size()));
  return std::make_unique<UdpLink>(udp_socket(), &peer);
}

std::unique_ptr<Link> make_pty(const std::string& path) {
  const int fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0 || grantpt(fd) != 0 || unlockpt(fd) != 0) fail("pty");
  char name[128];
  if (ptsname_r(fd, name, sizeof name) != 0) fail("pty");
  const int other = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
  if (other < 0) fail(name);
  make_raw(other, 3000000, name);
  if (fs::is_symlink(path)) fs::remove(path);
  std::error_code error;
  fs::create_symlink(name, path, error);
  if (error) {
    close(fd);
    close(other);
    throw BadInput(fmt::format("{}: {}", path, error.message()));
  }
  return std::make_unique<PtyLink>(fd, other, path);
}

std::unique_ptr<Link> listen_udp(const std::string& host_port) {
  const sockaddr_in address = address_of(host_port);
  const int fd = udp_socket();
  auto link = std::make_unique<UdpLink>(fd, nullptr);
  if (bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) fail(host_port);
  return link;
}

}  // namespace twinrate
