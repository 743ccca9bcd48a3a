#include "run/udp_ring.hpp"

#include <arpa/inet.h>
#include <linux/filter.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstring>
#include <string>
#include <vector>

#include "core/lcm_socket.hpp"
#include "core/machine_error.hpp"
#include "core/realtime_setup.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kBytes = 160;  // a MEASUREMENT of LCM with its channel
constexpr std::int64_t kSecond = 1'000'000'000;

void require(bool ok, const char* what) {
  if (!ok) throw MachineError(std::string("ring: ") + what + ": " + std::strerror(errno));
}

sockaddr_in group() {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(17667);
  inet_pton(AF_INET, "239.255.76.68", &address.sin_addr);
  return address;
}

std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * kSecond + t.tv_nsec;
}

void sleep_until(std::int64_t due_ns) {
  const timespec t{.tv_sec = due_ns / kSecond, .tv_nsec = due_ns % kSecond};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
  }
}

double us(std::int64_t ns) {
  return 1e-3 * static_cast<double>(ns);
}

void pin_to_first_cpu() {
  cpu_set_t allowed, one;
  CPU_ZERO(&one);
  sched_getaffinity(0, sizeof allowed, &allowed);
  for (std::size_t cpu = 0; cpu < CPU_SETSIZE && CPU_COUNT(&one) == 0; ++cpu)
    if (CPU_ISSET(cpu, &allowed)) CPU_SET(cpu, &one);
  sched_setaffinity(0, sizeof one, &one);
}

}  // namespace

class UdpRing::Member {
 public:
  explicit Member(int index)
      : index_(index), in_(socket(AF_INET, SOCK_DGRAM, 0)), out_(socket(AF_INET, SOCK_DGRAM, 0)) {
    const int on = 1;
    const sockaddr_in at = group();
    setsockopt(in_.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    require(bind(in_.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0, "bind");
    const ip_mreq membership{at.sin_addr, {htonl(INADDR_ANY)}};
    require(
        setsockopt(in_.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) == 0,
        "no multicast route");
    sock_filter program[] = {
        BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 8),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<unsigned>(index), 1, 0),
        BPF_STMT(BPF_RET | BPF_K, 0), BPF_STMT(BPF_RET | BPF_K, 0xffffffff)};
    const sock_fprog filter{.len = 4, .filter = program};
    require(setsockopt(in_.get(), SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0,
            "filter");
    const timeval patience{.tv_sec = 0, .tv_usec = 20'000};
    setsockopt(in_.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    const std::uint8_t ttl = 0;
    setsockopt(out_.get(), IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
    require(connect(out_.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0, "connect");
  }
  bool receive() { return recv(in_.get(), bytes_.data(), bytes_.size(), 0) > 0; }
  void send() {
    bytes_[0] = static_cast<std::uint8_t>((index_ + 1) % kMembers);
    (void)::send(out_.get(), bytes_.data(), bytes_.size(), 0);
  }
  // The datagram of this round: one that was late before is passed over.
  std::int64_t round() const {
    std::int64_t k = 0;
    std::memcpy(&k, &bytes_[8], sizeof k);
    return k;
  }
  void set_round(std::int64_t k) { std::memcpy(&bytes_[8], &k, sizeof k); }

 private:
  int index_;
  FileDescriptor in_, out_;
  std::array<std::uint8_t, kBytes> bytes_{};
};

struct UdpRing::Before {
  cpu_set_t cpus{};
  bool realtime = has_realtime_policy();
  Before() { sched_getaffinity(0, sizeof cpus, &cpus); }
  ~Before() {
    if (!realtime && has_realtime_policy()) leave_fifo();
    sched_setaffinity(0, sizeof cpus, &cpus);
  }
};

UdpRing::UdpRing(int priority, bool pinned) : before_(std::make_unique<Before>()) {
  own_ = std::make_unique<Member>(0);
  if (pinned) pin_to_first_cpu();
  for (int i = 1; i < kMembers; ++i) {
    pid_t& child = others_[static_cast<std::size_t>(i - 1)];
    child = fork();
    require(child >= 0, "fork");
    if (child > 0) continue;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
      take_fifo(priority);
      Member member(i);
      while (true)
        if (member.receive()) member.send();
    } catch (...) {
      _exit(3);
    }
  }
  take_fifo(priority);
  bool all = false;  // they join one after the other
  for (int i = 0; i < 100 && !all; ++i) all = pass_round();
  require(all, "no datagram comes back");
}

UdpRing::~UdpRing() {
  for (const pid_t child : others_)
    if (child > 0) {
      kill(child, SIGKILL);
      waitpid(child, nullptr, 0);
    }
}

bool UdpRing::pass_round() {
  const std::int64_t k = own_->round() + 1;
  own_->set_round(k);
  own_->send();
  while (own_->receive())
    if (own_->round() == k) return true;
  own_->set_round(k);
  return false;
}

RingResult UdpRing::run(double rate_Hz, double seconds) {
  const auto period = static_cast<std::int64_t>(std::llround(1e9 / rate_Hz));
  RingResult result{.ticks = std::llround(seconds * rate_Hz)};
  std::vector<double> late, round;
  late.reserve(static_cast<std::size_t>(result.ticks));
  round.reserve(static_cast<std::size_t>(result.ticks));
  const std::int64_t start = now_ns() + 20 * period;
  for (std::int64_t k = 0; k < result.ticks; ++k) {
    const std::int64_t due = start + k * period;
    if (now_ns() >= due + period) {  // it could not begin in its time
      ++result.missed;
      continue;
    }
    sleep_until(due);
    const std::int64_t sent = now_ns();
    const bool back = pass_round();
    const std::int64_t returned = now_ns();
    late.push_back(us(sent - due));
    if (back) round.push_back(us(returned - sent));
    if (!back || returned > due + period) ++result.missed;
  }
  result.late_us = percentiles_of(late);
  result.round_us = percentiles_of(round);
  return result;
}

}  // namespace twinrate
