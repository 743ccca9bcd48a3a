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
#include "run/cpu_plan.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kBytes = 160;  // a MEASUREMENT of LCM with its channel
// The processes of a ring; kTaker takes every datagram in.
enum Index : int { kOne, kTwo, kThree, kFour, kTaker };
constexpr int kNobody = 0xff;  // the address of what the taker alone receives
constexpr int kFourEvery = 5;  // rounds
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

}  // namespace

class UdpRing::Member {
 public:
  explicit Member(int index)
      : index_(index), in_(socket(AF_INET, SOCK_DGRAM, 0)), out_(socket(AF_INET, SOCK_DGRAM, 0)) {
    const int on = 1;
    const sockaddr_in& at = to_;
    setsockopt(in_.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    require(bind(in_.get(), reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0, "bind");
    const ip_mreq membership{at.sin_addr, {htonl(INADDR_ANY)}};
    require(
        setsockopt(in_.get(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) == 0,
        "no multicast route");
    if (index != kTaker) attach_filter(index);
    const timeval patience{.tv_sec = 0, .tv_usec = 20'000};
    setsockopt(in_.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    const std::uint8_t ttl = 0;
    setsockopt(out_.get(), IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
  }
  bool receive(int flags = 0) { return recv(in_.get(), bytes_.data(), bytes_.size(), flags) > 0; }
  void send(int to) {
    bytes_[0] = static_cast<std::uint8_t>(to);
    bytes_[1] = static_cast<std::uint8_t>(round() % kFourEvery);
    bytes_[2] = static_cast<std::uint8_t>(index_);
    // Not connected, as core/lcm_socket.
    (void)sendto(out_.get(), bytes_.data(), bytes_.size(), 0,
                 reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
  }
  int sender() const { return bytes_[2]; }
  // The datagram of this round: one that was late before is passed over.
  std::int64_t round() const {
    std::int64_t k = 0;
    std::memcpy(&k, &bytes_[8], sizeof k);
    return k;
  }
  void set_round(std::int64_t k) { std::memcpy(&bytes_[8], &k, sizeof k); }

 private:
  // What is addressed to it; the fourth receives what the third does, every fifth round.
  void attach_filter(int index) {
    const auto to = static_cast<unsigned>(index == kFour ? kThree : index);
    const auto round_bits = index == kFour ? 0xffU : 0U;
    sock_filter program[] = {BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 8),
                             BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, to, 0, 3),
                             BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 9),
                             BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, round_bits, 1, 0),
                             BPF_STMT(BPF_RET | BPF_K, 0xffffffff),
                             BPF_STMT(BPF_RET | BPF_K, 0)};
    const sock_fprog filter{.len = 6, .filter = program};
    require(setsockopt(in_.get(), SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0,
            "filter");
  }

  int index_;
  const sockaddr_in to_ = group();
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

[[noreturn]] void UdpRing::be_member(int index, Datagrams datagrams) {
  const bool tick = datagrams == Datagrams::kTick;
  Member member(index);
  while (true) {
    if (index == kTaker) {
      usleep(1000);
      while (member.receive(MSG_DONTWAIT)) {
      }
      continue;
    }
    if (!member.receive() || member.sender() == kFour) continue;
    if (tick && index == kThree) member.send(kNobody);
    member.send(index == kFour ? kTwo : index == kThree ? kOne : index + 1);
  }
}

UdpRing::UdpRing(int priority, bool pinned, Datagrams datagrams)
    : before_(std::make_unique<Before>()), datagrams_(datagrams) {
  own_ = std::make_unique<Member>(kOne);
  if (pinned) pin_to_first_cpu();
  for (int i = kTwo; i <= (datagrams == Datagrams::kTick ? kTaker : kThree); ++i) {
    const pid_t child = fork();
    require(child >= 0, "fork");
    others_.push_back(child);
    if (child > 0) continue;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
      if (i == kTaker) sched_setaffinity(0, sizeof before_->cpus, &before_->cpus);
      take_fifo(priority);
      be_member(i, datagrams);
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
  if (datagrams_ == Datagrams::kTick) own_->send(kNobody);
  own_->send(kTwo);
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
