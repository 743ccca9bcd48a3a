// The CPUs of a pinned set, beside the other sets of this machine.
//
// A ring in realtime takes a third to a half of its CPU at 5 kHz. Two of them on one CPU want more than
// SCHED_FIFO processes get together (kernel.sched_rt_runtime_us, 0.95 s of each second), and the kernel
// then halts both for 50 ms. So the ring of a set goes to the CPU with the fewest rings.
#pragma once
#include <string>
#include <vector>

namespace twinrate {

// A set whose plant runs on this machine, in whatever network namespace.
struct OtherSet {
  std::string run_dir, url;
  int ring_cpu = -1;  // -1: not pinned
  bool realtime = false;
  bool same_network = true;
};

// From the command lines below `proc`, in the order of the process ids.
std::vector<OtherSet> other_sets(const std::string& proc = "/proc");

// One CPU for the ring, one for the other processes. -1: not pinned.
struct CpuPlan {
  int ring = -1, others = -1;
};
// CPUs that this process may use.
std::vector<int> allowed_cpus();
// Of those the first, for this process.
void pin_to_first_cpu();
// The two CPUs with the fewest rings, of equal ones the first; not pinned with less than two.
CpuPlan plan_cpus(std::vector<int> allowed, const std::vector<OtherSet>& sets);

// One launch of this machine plans at a time. It holds the lock from the plan until the command line of its
// plant shows the CPU: two launches that plan at once would choose the same CPU.
class PlanLock {
 public:
  // Waits at most kPatience_s: somebody who keeps it halts no launch.
  PlanLock();
  ~PlanLock();
  PlanLock(const PlanLock&) = delete;
  PlanLock& operator=(const PlanLock&) = delete;
  bool held() const { return held_; }
  static constexpr double kPatience_s = 1;

 private:
  int directory_;
  bool held_ = false;
};
// Returns when the process runs its program, or after 0.2 s.
void wait_until_it_shows(int plant_pid);

// What a realtime set should know of the others: one line each; none if no other one is in realtime.
// `filtered`: bus.filter, without which each process of the set hears the others on its URL.
std::vector<std::string> realtime_beside(const std::vector<OtherSet>& sets, const CpuPlan& plan,
                                         const std::string& url, bool filtered);

}  // namespace twinrate
