// The floor of lock-step over shared memory: three processes on one CPU pass a message of the size of a
// MEASUREMENT round, each asleep on a futex until its turn. No checks, no mathematics, no log.
//
//   raw_shared_ring [STEPS]      prints rounds per second
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <climits>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <utility>

#include "core/machine_error.hpp"
#include "core/report_error.hpp"
#include "core/seconds_since.hpp"
#include "run/cpu_plan.hpp"

namespace {

using twinrate::MachineError;

constexpr std::size_t kMembers = 3, kBytes = 160;

// What one process passes to the next.
struct Box {
  alignas(64) std::atomic<std::uint32_t> round;
  std::array<std::uint8_t, kBytes> bytes;
};
using Boxes = std::array<Box, kMembers>;

void futex(std::atomic<std::uint32_t>& word, int operation, std::uint32_t value) {
  syscall(SYS_futex, &word, operation, value, nullptr, nullptr, 0);
}

void take(Box& box, std::uint32_t round, std::array<std::uint8_t, kBytes>& bytes) {
  for (std::uint32_t seen; (seen = box.round.load(std::memory_order_acquire)) != round;)
    futex(box.round, FUTEX_WAIT, seen);
  bytes = box.bytes;
}

void give(Box& box, std::uint32_t round, const std::array<std::uint8_t, kBytes>& bytes) {
  box.bytes = bytes;
  box.round.store(round, std::memory_order_release);
  futex(box.round, FUTEX_WAKE, INT_MAX);
}

[[noreturn]] void be_member(Boxes& boxes, std::size_t index) {
  std::array<std::uint8_t, kBytes> bytes{};
  for (std::uint32_t round = 1;; ++round) {
    take(boxes[index], round, bytes);
    give(boxes[(index + 1) % kMembers], round, bytes);
  }
}

// Rounds per second; this process is the first of the ring.
double measure(Boxes& boxes, std::uint32_t steps) {
  std::array<std::uint8_t, kBytes> bytes{};
  const auto begun = std::chrono::steady_clock::now();
  for (std::uint32_t round = 1; round <= steps; ++round) {
    give(boxes[1], round, bytes);
    take(boxes[0], round, bytes);
  }
  return steps / twinrate::seconds_since(begun);
}

}  // namespace

int main(int argc, char** argv) try {
  const auto steps = static_cast<std::uint32_t>(argc > 1 ? std::atol(argv[1]) : 100'000);
  void* memory =
      mmap(nullptr, sizeof(Boxes), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) throw MachineError("mmap: no shared memory");
  Boxes& boxes = *new (memory) Boxes{};
  twinrate::pin_to_first_cpu();
  std::array<pid_t, kMembers - 1> others{};
  for (std::size_t i = 0; i < others.size(); ++i) {
    others[i] = fork();
    if (others[i] < 0) throw MachineError("fork: no process");
    if (others[i] > 0) continue;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    be_member(boxes, i + 1);
  }
  std::printf("%.0f\n", measure(boxes, steps));
  for (const pid_t other : others) {
    kill(other, SIGKILL);
    waitpid(other, nullptr, 0);
  }
  return 0;
} catch (...) {
  return twinrate::report_error("raw_shared_ring");
}
