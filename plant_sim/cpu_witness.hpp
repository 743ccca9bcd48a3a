// Detects whether a CPU of this machine runs: a thread on it notes the time every kPeriod_ns.
//
//   it is late by more than kSlack_ns     the CPU was stopped, or ran other work, from the missed
//                                         wake-up on
//
// A supervisor that is silent during this time may be healthy: no process on its CPU could have
// sent. A supervisor that is stopped, waits or spins leaves the CPU to the thread. kSlack_ns is
// above the delay of a wake-up on a busy machine (1 to 8 ms were seen with the normal scheduler)
// and below the 65 ms between a due heartbeat and safety.supervisor_ms.
#pragma once
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <latch>
#include <thread>

namespace twinrate {

// The stopped time, from looks at the last note; without a clock of its own.
class StoodTime {
 public:
  static constexpr std::int64_t kPeriod_ns = 5'000'000, kSlack_ns = 10'000'000;
  // The part of the stopped time that no earlier call has counted.
  std::int64_t look(std::int64_t now_ns, std::int64_t noted_ns) {
    if (now_ns - noted_ns <= kPeriod_ns + kSlack_ns) return 0;
    const std::int64_t from = std::max(counted_until_ns_, noted_ns + kPeriod_ns);
    counted_until_ns_ = now_ns;
    return std::max<std::int64_t>(0, now_ns - from);
  }

 private:
  std::int64_t counted_until_ns_ = INT64_MIN;
};

// The silence of a process without the time during which its CPU was stopped.
class AwakeSilence {
 public:
  // `silent_s`: since its last heartbeat, less the listener's own stalls; `stood_s`: stopped time
  // of its CPU since the last call.
  double take(double silent_s, double stood_s) {
    stood_s_ = std::min(stood_s_, silent_s) + stood_s;
    return silent_s - stood_s_;
  }
  double stood_s() const { return stood_s_; }

 private:
  double stood_s_ = 0;
};

class CpuWitness {
 public:
  // `priority`: of the watched process (SCHED_FIFO; 0: the normal scheduler). The thread has one
  // more, so a watched process that spins does not keep the CPU from it, and is found silent.
  // Returns when the thread runs on that CPU.
  CpuWitness(int cpu, int priority);
  ~CpuWitness();
  CpuWitness(const CpuWitness&) = delete;
  CpuWitness& operator=(const CpuWitness&) = delete;

  // As StoodTime::look(). Does not block.
  std::int64_t stood_ns(std::int64_t now_ns) { return stood_.look(now_ns, noted_ns_.load()); }

 private:
  void note(int cpu, int priority);

  StoodTime stood_;
  std::atomic<std::int64_t> noted_ns_;
  std::atomic<bool> ends_ = false;
  std::latch ready_{1};
  std::thread thread_;
};

}  // namespace twinrate
