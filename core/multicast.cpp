#include "core/multicast.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace twinrate {
namespace {

class UdpSocket {
 public:
  UdpSocket() : fd_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  ~UdpSocket() {
    if (fd_ >= 0) close(fd_);
  }
  UdpSocket(const UdpSocket&) = delete;
  UdpSocket& operator=(const UdpSocket&) = delete;
  int fd() const { return fd_; }

 private:
  int fd_;
};

bool read_loopback_flags(int fd, ifreq& request) {
  std::memset(&request, 0, sizeof request);
  std::strncpy(request.ifr_name, "lo", IFNAMSIZ - 1);
  return ioctl(fd, SIOCGIFFLAGS, &request) == 0;
}

sockaddr inet_sockaddr(const char* address) {
  sockaddr_in in{};
  in.sin_family = AF_INET;
  inet_pton(AF_INET, address, &in.sin_addr);
  sockaddr generic;
  static_assert(sizeof in == sizeof generic);
  std::memcpy(&generic, &in, sizeof generic);
  return generic;
}

// ip link set lo up multicast on
bool raise_loopback(int fd, std::string& done) {
  ifreq request;
  if (!read_loopback_flags(fd, request)) return false;
  const int wanted = request.ifr_flags | IFF_UP | IFF_MULTICAST;
  if (request.ifr_flags == wanted) return true;
  request.ifr_flags = static_cast<short>(wanted);
  if (ioctl(fd, SIOCSIFFLAGS, &request) != 0) return false;
  done += "ip link set lo up multicast on";
  return true;
}

// ip route add 224.0.0.0/4 dev lo
bool add_multicast_route(int fd, std::string& done) {
  char device[] = "lo";
  rtentry route{};
  route.rt_dst = inet_sockaddr("224.0.0.0");
  route.rt_genmask = inet_sockaddr("240.0.0.0");
  route.rt_flags = RTF_UP;
  route.rt_dev = device;
  if (ioctl(fd, SIOCADDRT, &route) != 0) return errno == EEXIST;
  done += std::string(done.empty() ? "" : " && ") + "ip route add 224.0.0.0/4 dev lo";
  return true;
}

}  // namespace

bool multicast_route_exists(const std::string& address) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(7667);
  if (inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1) return false;
  const UdpSocket socket;
  // Connecting a UDP socket sends nothing: it only asks the kernel for a route.
  return connect(socket.fd(), reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0;
}

bool loopback_is_up() {
  const UdpSocket socket;
  ifreq request;
  return read_loopback_flags(socket.fd(), request) && (request.ifr_flags & IFF_UP) != 0;
}

bool try_bring_up_multicast(std::string& what_was_done) {
  what_was_done.clear();
  if (multicast_route_exists(kDefaultMulticastAddress)) return true;
  const UdpSocket socket;
  if (!raise_loopback(socket.fd(), what_was_done) ||
      !add_multicast_route(socket.fd(), what_was_done)) {
    what_was_done +=
        fmt::format("{}cannot: {}", what_was_done.empty() ? "" : ", then ", std::strerror(errno));
    return false;
  }
  return multicast_route_exists(kDefaultMulticastAddress);
}

std::string multicast_mend() {
  return "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo";
}

}  // namespace twinrate
