// Why a tick of the realtime plant began late.
//
// The time since the last tick began is the process's own CPU time, the time in which it was ready and
// another process had its CPU (/proc/thread-self/schedstat), and sleep. Late by more than half a period:
//
//   waited for the CPU for half the delay or more   another process
//   worked for longer than a period, and for half   its own work: messages, or the plant
//   the delay or more
//   a page came from disk                           memory
//   else                                            woken late: by the timer, by a host that
//                                                   stopped this machine, or it was stopped
#pragma once
#include <cstdint>
#include <string>

namespace twinrate {

// Of this thread, since it began.
struct ThreadTimes {
  std::int64_t cpu_ns = 0, waited_ns = 0;  // waited_ns: -1: unknown to the kernel
  long pages_from_disk = 0;
};
class ThreadClock {
 public:
  ThreadClock();
  ~ThreadClock();
  ThreadClock(const ThreadClock&) = delete;
  ThreadClock& operator=(const ThreadClock&) = delete;
  ThreadTimes now() const;

 private:
  int schedstat_;
};

// Text with the delay and its cause. `spent`: from the begin of the last tick to that of this one.
std::string late_text(const ThreadTimes& spent, std::int64_t late_ns, std::int64_t period_ns);

// Limits events of one kind to one in 100 ms, except one that is twice as large; the others are
// counted. An event for every tick of a late drive would delay the drive further.
class PacedEvents {
 public:
  // The text to send, with the number of the events since the last one; "": none now.
  std::string take(std::int64_t t_ns, std::int64_t size, const std::string& text);
  // Number of events that are not reported yet.
  std::int64_t since() const { return since_; }

 private:
  std::int64_t last_ns_ = INT64_MIN / 2, reported_size_ = 0, since_ = 0;
};

}  // namespace twinrate
