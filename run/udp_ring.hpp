// Three processes on one CPU pass a multicast datagram round, at a rate: what a machine can do for a
// drive without a drive.
//
// No LCM, no mathematics, no log. A kernel filter lets a datagram wake its receiver alone, as the
// channel filter of a set does.
#pragma once
#include <sys/types.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "run/hop_latency.hpp"

namespace twinrate {

struct RingResult {
  std::int64_t ticks = 0;
  std::int64_t missed = 0;  // the datagram was not back before the next tick
  Percentiles late_us;      // of the wake-up of a tick
  Percentiles round_us;     // from sending to its return
};

class UdpRing {
 public:
  // `priority`: of SCHED_FIFO for all three while the ring is there; 0: the normal scheduler. Pins the calling thread
  // and its children to one CPU where `pinned`. Throws MachineError where there is no multicast.
  UdpRing(int priority, bool pinned);
  ~UdpRing();
  UdpRing(const UdpRing&) = delete;
  UdpRing& operator=(const UdpRing&) = delete;

  // False where the datagram was lost, after 20 ms.
  bool pass_round();
  RingResult run(double rate_Hz, double seconds);

 private:
  class Member;
  struct Before;  // affinity and policy
  static constexpr int kMembers = 3;
  std::unique_ptr<Before> before_;
  std::unique_ptr<Member> own_;
  std::array<pid_t, kMembers - 1> others_{};
};

}  // namespace twinrate
