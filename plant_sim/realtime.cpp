#include "plant_sim/realtime.hpp"

#include <fmt/format.h>
#include <sched.h>
#include <time.h>

#include <algorithm>
#include <memory>

#include "core/realtime_setup.hpp"
#include "core/signals_io.hpp"
#include "core/stall_text.hpp"
#include "plant_sim/cpu_witness.hpp"
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

void sleep_until(std::int64_t at_ns) {
  const timespec t{.tv_sec = at_ns / kSecond, .tv_nsec = at_ns % kSecond};
  clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr);
}

// Handles the received messages, sleeps until `deadline` and handles the messages of that time. A
// message does not wake the plant: COMMAND is used at the next tick. A flood of messages does not
// delay the tick.
//
// A CPU that sleeps to the deadline wakes late, at times by more than 0.1 ms if it is a virtual
// one. With a realtime policy the plant is awake for the last stretch and yields to its equals. A
// late plant yields once: SCHED_FIFO would give its CPU to no other process until it had caught up.
// Without such a policy a yield would give the CPU away for a slice of several ms.
void work_until(Process& p, std::int64_t deadline, std::int64_t awake) {
  constexpr std::int64_t kLongestSleep = 10'000'000;
  const std::int64_t nap_end = deadline - awake;
  do {  // once even if it is late, for the heartbeat
    p.turn(0);
    while (now_ns() < nap_end && p.bus().handle(0)) {
    }
    sleep_until(std::min(nap_end, now_ns() + kLongestSleep));
  } while (now_ns() < nap_end && !p.stopping());
  if (awake > 0) {
    do sched_yield();
    while (now_ns() < deadline);
  }
  for (int i = 0; i < kMostMessages && p.bus().handle(0); ++i) {
  }
}

ThreadTimes since(const ThreadTimes& before, const ThreadTimes& now) {
  return {.cpu_ns = now.cpu_ns - before.cpu_ns,
          .waited_ns = now.waited_ns < 0 ? -1 : now.waited_ns - before.waited_ns,
          .pages_from_disk = now.pages_from_disk - before.pages_from_disk};
}

class RealtimePlant {
 public:
  RealtimePlant(Process& p, Plant& plant)
      : p_(p),
        plant_(plant),
        period_ns_(p.drive().t_ns(1)),
        awake_ns_(has_realtime_policy() ? std::min<std::int64_t>(50'000, period_ns_ / 4) : 0),
        supervisor_s_(1e-3 * p.config().read<SafetyParameters>().supervisor_ms),
        witness_(witness_of(p)),
        clock_(now_ns() + 20 * period_ns_, period_ns_) {}
  void run(std::int64_t steps) {
    last_ = thread_.now();
    for (std::int64_t k = 0; k < steps && !p_.stopping(); ++k) tick(k);
    const std::int64_t k = plant_.k() - 1;
    if (late_commands_.since() > 0)
      p_.event(
          Reason::kLateCommand, k,
          fmt::format("{} more commands were late since the last report", late_commands_.since()));
    if (clock_.count().stalls > 0)
      p_.event(Reason::kOverrun, k, "the plant's clock stood" + stall_text(clock_.count()));
  }

 private:
  void tick(std::int64_t k) {
    const PlantClock::Begin begin = clock_.begin(
        p_.drive().t_ns(k), [this](std::int64_t due) { work_until(p_, due, awake_ns_); },
        [] { return now_ns(); }, [this] { return plant_.command_is_missing(); });
    const ThreadTimes begun = thread_.now();
    if (begin.late_ns > period_ns_ / 2) report_miss(k, begin, since(last_, begun));
    last_ = begun;
    p_.bus().publish(to_wire(plant_.sample(), p_.bus().session()),
                     to_wire(plant_.truth(), p_.bus().session()));
    watch_supervisor(k);
    if (!plant_.advance()) report_late_command(k);
    publish_safety_events(p_, plant_, k);
    p_.progress(k);
  }
  void report_miss(std::int64_t k, const PlantClock::Begin& begin, const ThreadTimes& spent) {
    ++p_.status().deadline_misses;
    const bool stalled = begin.stood_ns > 0;
    std::string text = late_text(spent, begin.late_ns, period_ns_);
    if (stalled) text += "; the plant's clock stood";
    text = (stalled ? stalls_ : misses_).take(p_.drive().t_ns(k), begin.late_ns, text);
    if (!text.empty())
      p_.event(Reason::kOverrun, k, stalled ? text + stall_text(clock_.count()) : text);
    p_.clock_stood(begin.stood_ns);
  }
  static std::unique_ptr<CpuWitness> witness_of(Process& p) {
    if (p.options().helper_cpu < 0) return nullptr;
    return std::make_unique<CpuWitness>(
        p.options().helper_cpu,
        fifo_priority(p.config().read<RealtimeParameters>(), Role::kSupervisor));
  }
  // After 1 s of silence every process ends in any case.
  void watch_supervisor(std::int64_t k) {
    constexpr double kTold_s = 0.02;  // less is near the slack of the witness
    const double stood_before_s = silence_.stood_s();
    const double stood_s = witness_ ? 1e-9 * static_cast<double>(witness_->stood_ns(now_ns())) : 0;
    if (silence_.take(p_.supervisor_silent_s().value_or(0), stood_s) > supervisor_s_)
      plant_.supervisor_is_silent();
    if (stood_before_s > kTold_s && silence_.stood_s() < kTold_s)  // a heartbeat came
      p_.event(
          Reason::kOverrun, k,
          fmt::format(
              "CPU {} ran no process of this set for {:.0f} ms; this is not counted as silence of "
              "the supervisor",
              p_.options().helper_cpu, 1e3 * stood_before_s));
  }
  void report_late_command(std::int64_t k) {
    ++p_.status().late_commands;
    if (plant_.tripped()) return;
    const std::int64_t due = k - p_.drive().plant.delay_samples;
    const std::string text = late_commands_.take(
        p_.drive().t_ns(k), 1, fmt::format("COMMAND({}) was late: an older one is in force", due));
    if (!text.empty()) p_.event(Reason::kLateCommand, k, text);
  }

  Process& p_;
  Plant& plant_;
  std::int64_t period_ns_, awake_ns_;
  double supervisor_s_;
  std::unique_ptr<CpuWitness> witness_;  // of the supervisor's CPU
  AwakeSilence silence_;
  PlantClock clock_;
  ThreadClock thread_;
  ThreadTimes last_;
  PacedEvents misses_, stalls_, late_commands_;
};

}  // namespace

void publish_safety_events(Process& p, const Plant& plant, std::int64_t k) {
  for (int i = 0; i < plant.safety().event_count(); ++i) {
    const SafetyEvent& event = plant.safety().event(i);
    // A request was answered with its event.
    if (event.reason != Reason::kEmergencyStop || plant.stop_was_planned())
      p.event(event.reason, k, text_of(event, plant.safety()));
  }
}

void run_realtime(Process& p, Plant& plant, std::int64_t steps) {
  RealtimePlant(p, plant).run(steps);
}

}  // namespace twinrate
