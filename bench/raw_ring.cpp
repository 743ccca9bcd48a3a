// The floor of lock-step over multicast: three processes on one CPU pass a datagram round.
//
//   raw_ring [STEPS]      prints rounds per second
//
// No LCM, no mathematics, no log: each process receives 160 bytes with one system call and sends
// 160 bytes with one. A kernel filter lets a datagram wake its receiver alone, as the channel filter
// of the set does. A lock-step tick cannot be faster than a round.
#include <arpa/inet.h>
#include <linux/filter.h>
#include <sched.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

constexpr int kMembers = 3;
constexpr std::size_t kBytes = 160;  // a MEASUREMENT of LCM with its channel

void require(bool ok, const char* what) {
  if (ok) return;
  std::perror(what);
  std::exit(3);
}

sockaddr_in group() {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(17667);
  inet_pton(AF_INET, "239.255.76.68", &address.sin_addr);
  return address;
}

class Member {
 public:
  explicit Member(int index)
      : index_(index), in_(socket(AF_INET, SOCK_DGRAM, 0)), out_(socket(AF_INET, SOCK_DGRAM, 0)) {
    const int on = 1;
    const sockaddr_in at = group();
    setsockopt(in_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    require(bind(in_, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0, "bind");
    const ip_mreq membership{at.sin_addr, {htonl(INADDR_ANY)}};
    require(setsockopt(in_, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) == 0,
            "no multicast route");
    sock_filter program[] = {
        BPF_STMT(BPF_LD | BPF_B | BPF_ABS, 8),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<unsigned>(index), 1, 0),
        BPF_STMT(BPF_RET | BPF_K, 0), BPF_STMT(BPF_RET | BPF_K, 0xffffffff)};
    const sock_fprog filter{.len = 4, .filter = program};
    require(setsockopt(in_, SOL_SOCKET, SO_ATTACH_FILTER, &filter, sizeof filter) == 0, "filter");
    const timeval patience{.tv_sec = 0, .tv_usec = 20'000};
    setsockopt(in_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    require(connect(out_, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0, "connect");
  }
  bool receive() { return recv(in_, bytes_.data(), bytes_.size(), 0) > 0; }
  void send() {
    bytes_[0] = static_cast<std::uint8_t>((index_ + 1) % kMembers);
    require(::send(out_, bytes_.data(), bytes_.size(), 0) > 0, "send");
  }

 private:
  int index_, in_, out_;
  std::array<std::uint8_t, kBytes> bytes_{};
};

void pin() {
  cpu_set_t allowed, one;
  CPU_ZERO(&one);
  sched_getaffinity(0, sizeof allowed, &allowed);
  for (std::size_t cpu = 0; cpu < CPU_SETSIZE && CPU_COUNT(&one) == 0; ++cpu)
    if (CPU_ISSET(cpu, &allowed)) CPU_SET(cpu, &one);
  sched_setaffinity(0, sizeof one, &one);
}

[[noreturn]] void pass_on(int index) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  Member member(index);
  while (true)
    if (member.receive()) member.send();
}

}  // namespace

int main(int argc, char** argv) {
  const long steps = argc > 1 ? std::atol(argv[1]) : 20'000;
  pin();
  std::array<pid_t, kMembers> others{};
  for (int i = 1; i < kMembers; ++i)
    if ((others[static_cast<std::size_t>(i)] = fork()) == 0) pass_on(i);
  Member member(0);
  long done = -100;  // until all have joined
  auto begun = std::chrono::steady_clock::now();
  while (done < steps) {
    if (done == 0) begun = std::chrono::steady_clock::now();
    member.send();
    if (member.receive()) ++done;
  }
  const double wall_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  std::printf("%.0f\n", static_cast<double>(steps) / wall_s);
  for (int i = 1; i < kMembers; ++i) {
    kill(others[static_cast<std::size_t>(i)], SIGKILL);
    waitpid(others[static_cast<std::size_t>(i)], nullptr, 0);
  }
}
