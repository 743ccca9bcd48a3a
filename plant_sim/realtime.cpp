#include "plant_sim/realtime.hpp"

#include <fmt/format.h>
#include <time.h>

#include <cerrno>

#include "core/signals_io.hpp"

namespace twinrate {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

std::int64_t now_ns() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return t.tv_sec * kSecond + t.tv_nsec;
}

// Handles messages until `deadline`, then returns; the last stretch sleeps on the absolute clock.
void work_until(Process& p, std::int64_t deadline) {
  constexpr std::int64_t kSleepMargin = 60'000;  // poll() may oversleep by about this much
  while (now_ns() < deadline - kSleepMargin && !p.stopping())
    p.turn(static_cast<double>(deadline - kSleepMargin - now_ns()) * 1e-6);
  const timespec t{.tv_sec = deadline / kSecond, .tv_nsec = deadline % kSecond};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) {
  }
  while (p.bus().handle(0)) {
  }
}

}  // namespace

void run_realtime(Process& p, Plant& plant, std::int64_t steps) {
  const std::int64_t period = p.drive().t_ns(1);
  const std::int64_t start = now_ns() + 20 * period;
  bool reported_trip = false;
  for (std::int64_t k = 0; k < steps && !p.stopping(); ++k) {
    const std::int64_t due = start + p.drive().t_ns(k);
    work_until(p, due);
    if (now_ns() - due > period / 2) ++p.status().deadline_misses;
    p.bus().publish(to_wire(plant.sample(), p.bus().session()));
    p.bus().publish(to_wire(plant.truth(), p.bus().session()));
    if (!plant.advance()) {
      ++p.status().late_commands;
      if (!plant.tripped())
        p.event(Reason::kLateCommand, k,
                fmt::format("COMMAND({}) was late: the last voltage is held",
                            k - p.drive().plant.delay_samples));
    }
    if (plant.tripped() && !reported_trip) {
      reported_trip = true;
      p.event(Reason::kCommandLost, k, "no command for longer than plant.hold_ticks: zero voltage");
    }
    p.progress(k);
  }
}

}  // namespace twinrate
