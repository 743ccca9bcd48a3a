#include "plant_sim/realtime.hpp"

#include <fmt/format.h>
#include <time.h>

#include <algorithm>
#include <cerrno>

#include "core/signals_io.hpp"
#include "core/stall_text.hpp"
#include "plant_sim/overrun.hpp"
#include "plant_sim/plant_clock.hpp"

namespace twinrate {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr int kMostMessages = 100;  // of a tick; a refused one takes about 1 us

std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * kSecond + t.tv_nsec;
}

// Handles messages until `deadline`, then returns; the last stretch sleeps on the absolute clock.
void work_until(Process& p, std::int64_t deadline) {
  constexpr std::int64_t kSleepMargin = 60'000;  // poll() may oversleep by about this much
  do {                                           // once even where it is late: the heart beats
    p.turn(std::max(0.0, static_cast<double>(deadline - kSleepMargin - now_ns()) * 1e-6));
  } while (now_ns() < deadline - kSleepMargin && !p.stopping());
  const timespec t{.tv_sec = deadline / kSecond, .tv_nsec = deadline % kSecond};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
  }
  // What has come by then; a flood of messages does not hold the tick up.
  for (int i = 0; i < kMostMessages && p.bus().handle(0); ++i) {
  }
}

ThreadTimes since(const ThreadTimes& before, const ThreadTimes& now) {
  return {.cpu_ns = now.cpu_ns - before.cpu_ns,
          .waited_ns = now.waited_ns < 0 ? -1 : now.waited_ns - before.waited_ns,
          .pages_from_disk = now.pages_from_disk - before.pages_from_disk};
}

}  // namespace

void publish_safety_events(Process& p, const Plant& plant, std::int64_t k) {
  for (int i = 0; i < plant.safety().event_count(); ++i) {
    const SafetyEvent& event = plant.safety().event(i);
    if (event.reason != Reason::kEmergencyStop)  // the request was answered with one
      p.event(event.reason, k, text_of(event, plant.safety()));
  }
}

void run_realtime(Process& p, Plant& plant, std::int64_t steps) {
  const std::int64_t period = p.drive().t_ns(1);
  PlantClock clock(now_ns() + 20 * period, period);
  const double supervisor_s = 1e-3 * p.config().read<SafetyParameters>().supervisor_ms;
  const ThreadClock thread;
  ThreadTimes last = thread.now();
  OverrunReport misses, stalls;
  for (std::int64_t k = 0; k < steps && !p.stopping(); ++k) {
    const std::int64_t t_ns = p.drive().t_ns(k);
    const PlantClock::Begin begin = clock.begin(
        t_ns, [&](std::int64_t due) { work_until(p, due); }, [&] { return now_ns(); },
        [&] { return plant.command_is_missing(); });
    const ThreadTimes begun = thread.now();
    if (begin.late_ns > period / 2) {
      ++p.status().deadline_misses;
      const bool stalled = begin.stood_ns > 0;
      std::string cause = cause_of_delay(since(last, begun), begin.late_ns, period);
      if (stalled) cause += "; the plant's clock stood";
      const std::string text = (stalled ? stalls : misses).take(t_ns, begin.late_ns, cause);
      if (!text.empty())
        p.event(Reason::kOverrun, k, stalled ? text + stall_text(clock.count()) : text);
      p.clock_stood(begin.stood_ns);
    }
    last = begun;
    p.bus().publish(to_wire(plant.sample(), p.bus().session()),
                    to_wire(plant.truth(), p.bus().session()));
    if (p.supervisor_silent_s().value_or(0) > supervisor_s) plant.supervisor_is_silent();
    if (!plant.advance()) {
      ++p.status().late_commands;
      if (!plant.tripped())
        p.event(Reason::kLateCommand, k,
                fmt::format("COMMAND({}) was late: the last voltage is held",
                            k - p.drive().plant.delay_samples));
    }
    publish_safety_events(p, plant, k);
    p.progress(k);
  }
  if (clock.count().stalls > 0)
    p.event(Reason::kOverrun, plant.k() - 1, "the plant's clock stood" + stall_text(clock.count()));
}

}  // namespace twinrate
