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

// Number of further threads that may start now, at most `wanted`; each is working until it ends.
std::ptrdiff_t take_threads(std::ptrdiff_t wanted) {
  const std::ptrdiff_t most = std::min(usable_cpus(), kMostThreads) - 1;
  for (std::ptrdiff_t now = working;;) {
    const std::ptrdiff_t count = std::min(most - now, wanted);
    if (count <= 0) return 0;
    if (working.compare_exchange_weak(now, now + count)) return count;
  }
}

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
  std::ptrdiff_t to_start = take_threads(static_cast<std::ptrdiff_t>(count) - 1);
  std::vector<std::jthread> threads;
  try {
    for (; to_start > 0; --to_start)
      threads.emplace_back([&] {
        work();
        --working;
      });
  } catch (const std::system_error&) {  // a limit of threads: those that started do all steps
    working -= to_start;
  }
  work();
  if (!threads.empty()) {
    --working;  // while this one waits, a step of the others may use its CPU
    threads.clear();
    ++working;
  }
  if (thrown) std::rethrow_exception(thrown);
}

void together(std::initializer_list<std::function<void()>> steps) {
  for_each_index(steps.size(), [&](std::size_t i) { steps.begin()[i](); });
}

}  // namespace twinrate
