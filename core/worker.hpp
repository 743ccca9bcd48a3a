// A thread of normal scheduling that does one job at a time for a thread that must not wait.
#pragma once
#include <atomic>
#include <functional>
#include <thread>

namespace twinrate {

class Worker {
 public:
  Worker();
  ~Worker();  // after the job that runs
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  // True from start() until ended() was true.
  bool is_busy() const { return state_ != kIdle; }
  // Only while it is not busy. No exception leaves the job.
  void start(std::function<void()> job);
  // True once for each job: its results can be read.
  bool ended();

 private:
  enum State : int { kIdle, kStarted, kEnded, kLeaves };
  void work();

  std::atomic<int> state_ = kIdle;
  std::atomic<bool> leaves_ = false;
  std::function<void()> job_;
  std::thread thread_;
};

}  // namespace twinrate
