#include "trace/parallel.hpp"

#include <sched.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

namespace twinrate {
namespace {

constexpr std::ptrdiff_t kMostThreads = 8;  // each holds the signals of its step: memory

// Threads that work beside the callers. A step inside a step takes those that no other step has.
std::atomic<std::ptrdiff_t> working = 0;

std::ptrdiff_t usable_cpus() {
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  if (sched_getaffinity(0, sizeof cpus, &cpus) != 0) return 1;
  return std::max(1, CPU_COUNT(&cpus));
}

// The number of further threads, at most `wanted`, until it goes.
class Granted {
 public:
  explicit Granted(std::ptrdiff_t wanted) {
    const std::ptrdiff_t most = std::min(usable_cpus(), kMostThreads) - 1;
    for (std::ptrdiff_t now = working; wanted > 0;) {
      count_ = std::clamp<std::ptrdiff_t>(most - now, 0, wanted);
      if (count_ == 0 || working.compare_exchange_weak(now, now + count_)) return;
    }
  }
  ~Granted() { working -= count_; }
  Granted(const Granted&) = delete;
  Granted& operator=(const Granted&) = delete;
  std::ptrdiff_t count() const { return count_; }

 private:
  std::ptrdiff_t count_ = 0;
};

}  // namespace

void for_each_index(std::size_t count, const std::function<void(std::size_t)>& f) {
  std::atomic<std::size_t> next = 0;
  std::mutex guard;
  std::exception_ptr thrown;
  std::size_t thrown_at = count;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) {
      try {
        f(i);
      } catch (...) {
        next = count;
        const std::lock_guard lock(guard);
        if (i >= thrown_at) continue;
        thrown = std::current_exception();
        thrown_at = i;
      }
    }
  };
  const Granted granted(static_cast<std::ptrdiff_t>(count) - 1);
  std::vector<std::jthread> threads;
  try {
    for (std::ptrdiff_t t = 0; t < granted.count(); ++t) threads.emplace_back(work);
  } catch (const std::system_error&) {  // a limit of threads: those that started do all steps
  }
  work();
  threads.clear();
  if (thrown) std::rethrow_exception(thrown);
}

void together(std::initializer_list<std::function<void()>> steps) {
  for_each_index(steps.size(), [&](std::size_t i) { steps.begin()[i](); });
}

}  // namespace twinrate
