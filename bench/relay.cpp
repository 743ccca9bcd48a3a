// Joins network namespaces as a network would join hosts: passes the datagrams of an LCM group from
// each interface on to all the others, late, out of order, or not at all.
//
//   relay IFACE IFACE.. [--group 239.255.76.67] [--port 7667] [--delay-ms D] [--jitter-ms J]
//         [--loss P] [--seed N]
//
// A datagram takes D ms and up to J ms more, drawn for each; a share P is lost. SIGUSR1 cuts the link
// to the last interface, SIGUSR2 joins it again, SIGTERM ends and prints what was passed on. Runs in
// a namespace that has one end of a veth pair to each host: bench/hosts.
#include <arpa/inet.h>
#include <fmt/format.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <queue>
#include <system_error>
#include <vector>

#include "bench/command_line.hpp"
#include "core/lcm_socket.hpp"
#include "core/report_error.hpp"
#include "model/random.hpp"

namespace {

using namespace twinrate;
using Clock = std::chrono::steady_clock;

volatile std::sig_atomic_t is_cut = 0, ends = 0;

struct Datagram {
  Clock::time_point due;
  std::uint64_t number = 0;
  std::size_t from = 0;
  std::vector<std::uint8_t> bytes;
  bool operator<(const Datagram& other) const {  // the next one is the greatest
    return due != other.due ? due > other.due : number > other.number;
  }
};

void check(int result, const char* what) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), what);
}

// One interface: hears the group there, and speaks there without hearing itself.
struct Interface {
  Interface(const std::string& name, const sockaddr_in& group)
      : in(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)),
        out(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    check(in.get(), "socket");
    check(out.get(), "socket");
    ip_mreqn membership{};
    membership.imr_multiaddr = group.sin_addr;
    membership.imr_ifindex = static_cast<int>(if_nametoindex(name.c_str()));
    if (membership.imr_ifindex == 0) check(-1, name.c_str());
    constexpr int kOn = 1, kBuffer = 4 << 20;
    constexpr std::uint8_t kOff = 0;
    check(setsockopt(in.get(), SOL_SOCKET, SO_REUSEADDR, &kOn, sizeof kOn), "port shared");
    check(setsockopt(in.get(), SOL_SOCKET, SO_BINDTODEVICE, name.c_str(),
                     static_cast<socklen_t>(name.size())),
          name.c_str());
    setsockopt(in.get(), SOL_SOCKET, SO_RCVBUF, &kBuffer, sizeof kBuffer);
    check(bind(in.get(), reinterpret_cast<const sockaddr*>(&group), sizeof group), "bind");
    check(setsockopt(in.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership),
          "joining the group");
    check(setsockopt(out.get(), IPPROTO_IP, IP_MULTICAST_IF, &membership, sizeof membership),
          "interface");
    check(setsockopt(out.get(), IPPROTO_IP, IP_MULTICAST_LOOP, &kOff, sizeof kOff), "loop");
    check(connect(out.get(), reinterpret_cast<const sockaddr*>(&group), sizeof group), "no route");
  }
  FileDescriptor in, out;
};

struct Options {
  std::vector<std::string> interfaces;
  std::string group = "239.255.76.67";
  int port = 7667, seed = 1;
  double delay_ms = 0, jitter_ms = 0, loss = 0;
};

class Relay {
 public:
  explicit Relay(const Options& o) : o_(o) {
    sockaddr_in group{};
    group.sin_family = AF_INET;
    group.sin_port = htons(static_cast<std::uint16_t>(o.port));
    if (inet_pton(AF_INET, o.group.c_str(), &group.sin_addr) != 1)
      throw std::runtime_error(o.group + ": no address");
    for (const std::string& name : o.interfaces)
      interfaces_.push_back(std::make_unique<Interface>(name, group));
  }
  void run() {
    std::vector<pollfd> polled;
    for (const auto& i : interfaces_)
      polled.push_back({.fd = i->in.get(), .events = POLLIN, .revents = 0});
    while (!ends) {
      const timespec pause = until_next();
      ppoll(polled.data(), polled.size(), &pause, nullptr);
      for (std::size_t i = 0; i < interfaces_.size(); ++i) read(i);
      for (; !waiting_.empty() && waiting_.top().due <= Clock::now(); waiting_.pop())
        pass_on(waiting_.top());
    }
    fmt::print("passed on {}, lost {}, cut {}\n", passed_on_, lost_, cut_);
  }

 private:
  timespec until_next() const {
    constexpr std::int64_t kSecond = 1'000'000'000;
    if (waiting_.empty()) return {.tv_sec = 0, .tv_nsec = kSecond / 10};
    const std::int64_t ns = std::clamp<std::int64_t>(
        std::chrono::nanoseconds(waiting_.top().due - Clock::now()).count(), 0, kSecond / 10);
    return {.tv_sec = 0, .tv_nsec = ns};
  }
  void read(std::size_t from) {
    while (true) {
      const ssize_t size =
          recv(interfaces_[from]->in.get(), buffer_.data(), buffer_.size(), MSG_DONTWAIT);
      if (size < 0) return;
      const std::uint64_t number = number_++;
      const auto seed = static_cast<std::uint64_t>(o_.seed);
      if (uniform(seed, 1, number) <= o_.loss) {
        ++lost_;
        continue;
      }
      const double ms = o_.delay_ms + o_.jitter_ms * uniform(seed, 2, number);
      waiting_.push({Clock::now() + std::chrono::nanoseconds(static_cast<std::int64_t>(1e6 * ms)),
                     number, from,
                     std::vector<std::uint8_t>(buffer_.begin(), buffer_.begin() + size)});
    }
  }
  void pass_on(const Datagram& datagram) {
    for (std::size_t to = 0; to < interfaces_.size(); ++to) {
      if (to == datagram.from) continue;
      const std::size_t last = interfaces_.size() - 1;
      if (is_cut && (to == last || datagram.from == last)) {
        ++cut_;
        continue;
      }
      if (send(interfaces_[to]->out.get(), datagram.bytes.data(), datagram.bytes.size(), 0) >= 0)
        ++passed_on_;
    }
  }

  Options o_;
  std::vector<std::unique_ptr<Interface>> interfaces_;
  std::priority_queue<Datagram> waiting_;
  std::array<std::uint8_t, 65536> buffer_{};
  std::uint64_t number_ = 0;
  std::int64_t passed_on_ = 0, lost_ = 0, cut_ = 0;
};

}  // namespace

int main(int argc, char** argv) try {
  twinrate::bench::CommandLine command_line(
      "Joins network namespaces as a network would join hosts");
  Options o;
  command_line.option("INTERFACES", &o.interfaces, "one interface of each host").required();
  command_line.option("--group", &o.group, "LCM's multicast group");
  command_line.option("--port", &o.port, "and port");
  command_line.option("--delay-ms", &o.delay_ms, "delay of every datagram");
  command_line.option("--jitter-ms", &o.jitter_ms, "further delay, drawn between 0 and this");
  command_line.option("--loss", &o.loss, "share of the datagrams that is lost");
  command_line.option("--seed", &o.seed, "draw from this seed");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  const auto on_signal = [](int number) {
    if (number == SIGTERM || number == SIGINT)
      ends = 1;
    else
      is_cut = number == SIGUSR1;
  };
  for (const int number : {SIGTERM, SIGINT, SIGUSR1, SIGUSR2}) std::signal(number, on_signal);
  Relay(o).run();
  return 0;
} catch (...) {
  return twinrate::report_error("relay");
}
