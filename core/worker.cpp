#include "core/worker.hpp"

#include <sched.h>

#include <cassert>
#include <utility>

#include "core/realtime_setup.hpp"

namespace twinrate {

Worker::Worker() : thread_([this] { work(); }) {}

Worker::~Worker() {
  leaves_ = true;
  state_ = kLeaves;
  state_.notify_one();
  thread_.join();
}

void Worker::start(std::function<void()> job) {
  assert(state_ == kIdle);
  job_ = std::move(job);
  state_ = kStarted;
  state_.notify_one();
}

bool Worker::ended() {
  int state = kEnded;
  return state_.compare_exchange_strong(state, kIdle);
}

// On any CPU: the thread that it works for may leave none of its own.
void Worker::work() {
  leave_fifo();
  cpu_set_t all;
  CPU_ZERO(&all);
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) CPU_SET(cpu, &all);
  sched_setaffinity(0, sizeof all, &all);
  while (!leaves_) {
    const int state = state_;
    if (state == kLeaves) return;
    if (state != kStarted) {
      state_.wait(state);
      continue;
    }
    job_();
    job_ = nullptr;
    state_ = kEnded;
  }
}

}  // namespace twinrate
