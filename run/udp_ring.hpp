// Three processes on one CPU pass a multicast datagram round, at a rate: what a machine can do for a
// drive without a drive.
//
// No LCM, no mathematics, no log. A kernel filter lets a datagram wake its receiver alone, as the
// channel filter of a set does. Datagrams of a round:
//
//   kThree   one from each process to the next
//   kTick    those of a lock-step tick, to as many processes: two from the first (MEASUREMENT,
//            TRUTH), one from the second (ESTIMATE), two from the third (REFERENCE, COMMAND); every
//            fifth round one from a fourth process to the second (GAIN); a fifth process, not
//            pinned, takes all of them in every millisecond (logger)
#pragma once
#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

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
  enum class Datagrams { kThree, kTick };
  // `priority`: of SCHED_FIFO for all in the ring while it is there; 0: the normal scheduler. Pins the calling thread
  // and its children to one CPU where `pinned`. Throws MachineError where there is no multicast.
  UdpRing(int priority, bool pinned, Datagrams datagrams = Datagrams::kThree);
  ~UdpRing();
  UdpRing(const UdpRing&) = delete;
  UdpRing& operator=(const UdpRing&) = delete;

  // False where the datagram was lost, after 20 ms.
  bool pass_round();
  RingResult run(double rate_Hz, double seconds);

 private:
  class Member;
  struct Before;  // affinity and policy
  [[noreturn]] static void be_member(int index, Datagrams datagrams);
  std::unique_ptr<Before> before_;
  Datagrams datagrams_;
  std::unique_ptr<Member> own_;
  std::vector<pid_t> others_;
};

}  // namespace twinrate
