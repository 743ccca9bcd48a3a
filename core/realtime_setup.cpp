#include "core/realtime_setup.hpp"

#include <fmt/format.h>
#include <malloc.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>

namespace twinrate {
namespace {

constexpr std::size_t kHeap = 16 << 20, kStack = 256 << 10;

// Writes to every page, so that none is mapped in mid-run.
void touch(volatile char* bytes, std::size_t size) {
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  for (std::size_t i = 0; i < size; i += page) bytes[i] = 0;
}

void touch_stack() {
  std::array<char, kStack> bytes;
  touch(bytes.data(), bytes.size());
}

void touch_heap() {
  mallopt(M_MMAP_MAX, 0);                                  // from the heap alone,
  mallopt(M_TRIM_THRESHOLD, static_cast<int>(2 * kHeap));  // which keeps freed memory
  void* heap = std::malloc(kHeap);
  if (heap) touch(static_cast<char*>(heap), kHeap);
  std::free(heap);
}

}  // namespace

int fifo_priority(const RealtimeParameters& wanted, Role role) {
  if (wanted.priority == 0) return 0;
  switch (role) {
    case Role::kPlant:
    case Role::kBridge:
    case Role::kEstimator:
    case Role::kController:
      return wanted.priority;
    case Role::kGain:
    case Role::kLogger:
    case Role::kSupervisor:
      return std::max(1, wanted.priority - 1);
    default:
      return 0;
  }
}

bool has_realtime_policy() {
  const int policy = sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;
  return policy == SCHED_FIFO || policy == SCHED_RR;
}

std::string take_fifo(int priority) {
  if (has_realtime_policy()) {
    sched_param held{};
    sched_getparam(0, &held);
    return fmt::format("realtime priority {}, as it was started", held.sched_priority);
  }
  if (priority == 0) return "";
  sched_param wanted{};
  wanted.sched_priority = priority;
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &wanted) != 0) return "";
  return fmt::format("SCHED_FIFO {}", priority);
}

void leave_fifo() {
  const sched_param normal{};  // the flag can be taken back with CAP_SYS_NICE only
  sched_setscheduler(0, SCHED_OTHER | SCHED_RESET_ON_FORK, &normal);
}

bool lock_memory() {
  touch_heap();
  touch_stack();
  return mlockall(MCL_CURRENT) == 0;
}

bool can_lock_memory() {
  if (mlockall(MCL_CURRENT) != 0) return false;
  munlockall();
  return true;
}

}  // namespace twinrate
