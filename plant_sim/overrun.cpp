#include "plant_sim/overrun.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <utility>

namespace twinrate {

ThreadClock::ThreadClock()
    : schedstat_(open("/proc/thread-self/schedstat", O_RDONLY | O_CLOEXEC)) {}
ThreadClock::~ThreadClock() {
  if (schedstat_ >= 0) close(schedstat_);
}

ThreadTimes ThreadClock::now() const {
  ThreadTimes times{.waited_ns = -1};
  timespec cpu{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &cpu);
  times.cpu_ns = cpu.tv_sec * std::int64_t{1'000'000'000} + cpu.tv_nsec;
  rusage use{};
  getrusage(RUSAGE_THREAD, &use);
  times.pages_from_disk = use.ru_majflt;
  std::array<char, 96> text{};
  if (schedstat_ < 0 || pread(schedstat_, text.data(), text.size() - 1, 0) <= 0) return times;
  char* end = nullptr;
  std::strtoll(text.data(), &end, 10);  // on the CPU
  times.waited_ns = std::strtoll(end, nullptr, 10);
  return times;
}

static std::string cause_of_delay(const ThreadTimes& spent, std::int64_t late_ns,
                                  std::int64_t period_ns) {
  const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
  if (spent.waited_ns >= late_ns / 2)
    return fmt::format("another process had the CPU for {:.0f} us", us(spent.waited_ns));
  if (spent.cpu_ns > period_ns && spent.cpu_ns >= late_ns / 2)
    return fmt::format("the plant worked for {:.0f} us", us(spent.cpu_ns));
  if (spent.pages_from_disk > 0)
    return fmt::format("{} pages came from disk", spent.pages_from_disk);
  return "it was woken late";
}

std::string late_text(const ThreadTimes& spent, std::int64_t late_ns, std::int64_t period_ns) {
  return fmt::format("tick began {:.0f} us late: {}", 1e-3 * static_cast<double>(late_ns),
                     cause_of_delay(spent, late_ns, period_ns));
}

std::string PacedEvents::take(std::int64_t t_ns, std::int64_t size, const std::string& text) {
  constexpr std::int64_t kPeriod_ns = 100'000'000;
  if (t_ns - last_ns_ < kPeriod_ns && size < 2 * reported_size_) {
    ++since_;
    return "";
  }
  last_ns_ = t_ns;
  reported_size_ = size;
  const std::int64_t between = std::exchange(since_, 0);
  return between > 0 ? fmt::format("{} ({} more since the last report)", text, between) : text;
}

}  // namespace twinrate
