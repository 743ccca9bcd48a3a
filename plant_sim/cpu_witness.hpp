// Whether a CPU of this machine runs: a thread on it that notes the time every kPeriod_ns.
//
//   it is late by more than kSlack_ns     the CPU stood, or gave its time to others, from the missed
//                                         wake-up on
//
// A supervisor that is silent then may be healthy: nobody on its CPU could have sent. One that is
// stopped, waits or spins leaves the CPU to the thread. kSlack_ns is above what a busy machine delays a wake-up by
// (1 to 8 ms were seen with the normal scheduler) and below the 65 ms between a heartbeat that is due
// and safety.supervisor_ms.
#pragma once
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <thread>

namespace twinrate {

// The time that stood, from looks at the last note; no clock in it.
class StoodTime {
 public:
  static constexpr std::int64_t kPeriod_ns = 5'000'000, kSlack_ns = 10'000'000;
  // Of it what no earlier look counted.
  std::int64_t look(std::int64_t now_ns, std::int64_t noted_ns) {
    if (now_ns - noted_ns <= kPeriod_ns + kSlack_ns) return 0;
    const std::int64_t from = std::max(counted_until_ns_, noted_ns + kPeriod_ns);
    counted_until_ns_ = now_ns;
    return std::max<std::int64_t>(0, now_ns - from);
  }

 private:
  std::int64_t counted_until_ns_ = INT64_MIN;
};

// The silence of a process without the time for which its CPU stood meanwhile.
class AwakeSilence {
 public:
  // `silent_s`: since its last heartbeat, less what the listener itself stalled for; `stood_s`: of its
  // CPU since the last call.
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
  // `priority`: of the watched process (SCHED_FIFO; 0: the normal scheduler). The thread has one more:
  // a watched process that spins keeps its CPU from nobody above it, and is found silent.
  CpuWitness(int cpu, int priority);
  ~CpuWitness();
  CpuWitness(const CpuWitness&) = delete;
  CpuWitness& operator=(const CpuWitness&) = delete;

  // As StoodTime. Waits for nobody.
  std::int64_t stood_ns(std::int64_t now_ns) { return stood_.look(now_ns, noted_ns_.load()); }

 private:
  void note(int cpu, int priority);

  StoodTime stood_;
  std::atomic<std::int64_t> noted_ns_;
  std::atomic<bool> ends_ = false;
  std::thread thread_;
};

}  // namespace twinrate
