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

constexpr std::size_t kMostThreads = 8;  // each holds the signals of its step: memory

std::size_t usable_cpus() {
  cpu_set_t cpus;
  CPU_ZERO(&cpus);
  if (sched_getaffinity(0, sizeof cpus, &cpus) != 0) return 1;
  return static_cast<std::size_t>(std::max(1, CPU_COUNT(&cpus)));
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
  std::vector<std::jthread> threads;
  const std::size_t wanted = std::min({count, usable_cpus(), kMostThreads});
  try {
    for (std::size_t t = 1; t < wanted; ++t) threads.emplace_back(work);
  } catch (const std::system_error&) {  // a limit of threads: those that started do all steps
  }
  work();
  threads.clear();
  if (thrown) std::rethrow_exception(thrown);
}

}  // namespace twinrate
