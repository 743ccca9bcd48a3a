// The realtime plant on a machine that stalls: a clock, a controller and stalls that are made up.
#include "plant_sim/plant_clock.hpp"

#include <gtest/gtest.h>
#include <sched.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <limits>
#include <thread>
#include <utility>
#include <vector>

#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "plant_sim/cpu_witness.hpp"
#include "plant_sim/plant.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/plant_of.hpp"

namespace twinrate::plant_clock_test {
namespace {

constexpr std::int64_t kPeriod = 200'000, kMs = 1'000'000;  // ns
constexpr int kHoldTicks = 19;                              // safety.hold_ms, 4 ms, less the delay

struct Stall {
  std::int64_t from, to;
};

// The controller answers MEASUREMENT(k) after 60 us in which it ran.
struct Machine {
  std::vector<Stall> of_all, of_controller;
  std::int64_t wakes_late = 0;  // the plant, each tick
  std::int64_t controller_ends = std::numeric_limits<std::int64_t>::max();

  std::int64_t missing = 0, off_k = -1;
  StallCount count;

  void run(std::int64_t ticks) {
    Plant plant = test::plant_of(test::load("dilys2021"));
    PlantClock clock(0, kPeriod);
    std::int64_t now = 0;
    std::deque<std::pair<std::int64_t, Command>> sent;  // arrival
    for (std::int64_t k = 0; k < ticks; ++k) {
      const auto wait_until = [&](std::int64_t due) {
        now = std::max(now, due) + wakes_late;
        for (const Stall& s : of_all)
          if (now >= s.from && now < s.to) now = s.to;  // the plant runs first after it
        for (; !sent.empty() && sent.front().first <= now; sent.pop_front())
          plant.take_command(sent.front().second);
      };
      clock.begin(
          k * kPeriod, wait_until, [&] { return now; }, [&] { return plant.command_is_missing(); });
      if (now < controller_ends)
        sent.emplace_back(answered(now), Command{.k = k, .mode = Mode::kRun});
      if (!plant.advance()) ++missing;
      if (plant.tripped() && off_k < 0) off_k = k;
    }
    count = clock.count();
  }

 private:
  std::int64_t answered(std::int64_t published) const {
    std::int64_t at = published + 60'000;
    for (const auto* stalls : {&of_all, &of_controller})
      for (const Stall& s : *stalls)
        if (at >= s.from && published < s.to) at += s.to - std::max(s.from, published);
    return at;
  }
};

TEST(PlantClock, AStallOfTheMachineTakesNoCommandAndIsCounted) {
  // In mid-tick; before the controller could answer; for a time just above a period.
  Machine machine{.of_all = {{20 * kMs + 150'000, 40 * kMs},
                             {60 * kMs + 10'000, 81 * kMs},
                             {100 * kMs + 150'000, 100 * kMs + 420'000}}};
  machine.run(1000);
  EXPECT_EQ(machine.off_k, -1);
  EXPECT_EQ(machine.missing, 0);
  EXPECT_EQ(machine.count.stalls, 3);
  EXPECT_NEAR(machine.count.stood_s, 0.0198 + 0.0208 + 0.0002, 0.0006);
  EXPECT_NEAR(machine.count.longest_s, 0.0208, 0.0002);
}

TEST(PlantClock, ALateControllerIsOffInItsTimeWhileThePlantIsAwake) {
  Machine machine{.of_controller = {{20 * kMs + 10'000, 40 * kMs}}};
  machine.run(300);
  EXPECT_EQ(machine.count.stalls, 0);
  EXPECT_EQ(machine.count.stood_s, 0);
  EXPECT_EQ(machine.off_k, 100 + 1 + kHoldTicks - 1);  // COMMAND(100) acts at tick 101
}

TEST(PlantClock, AControllerThatEndsInAStallIsOffWithinTheSameTicks) {
  Machine machine{.of_all = {{20 * kMs + 10'000, 50 * kMs}}, .controller_ends = 20 * kMs};
  machine.run(300);
  EXPECT_EQ(machine.count.stalls, 1);
  EXPECT_EQ(machine.off_k, 100 + 1 + kHoldTicks - 1);
}

TEST(PlantClock, AStallHelpsALateControllerByOnePeriodAndNoMore) {
  // The controller alone sleeps on after a stall of all.
  Machine machine{.of_all = {{20 * kMs + 10'000, 30 * kMs}},
                  .of_controller = {{30 * kMs, 50 * kMs}}};
  machine.run(300);
  EXPECT_EQ(machine.off_k, 100 + 1 + kHoldTicks - 1);
  EXPECT_NEAR(machine.count.stood_s, 0.0098 + 0.0002, 1e-9);
}

TEST(PlantClock, LateByLessThanAPeriodDoesNotMoveIt) {
  Machine machine{.wakes_late = kPeriod - 1000};
  machine.run(200);
  EXPECT_EQ(machine.count.stalls, 0);
  EXPECT_EQ(machine.count.stood_s, 0);
}

TEST(PlantClock, AMachineThatIsAlwaysLateGoesOnSlowlyAndSaysSo) {
  Machine machine{.wakes_late = 3 * kPeriod};
  machine.run(200);
  EXPECT_EQ(machine.missing, 0);
  EXPECT_GE(machine.count.stalls, 200);
  EXPECT_NEAR(machine.count.stood_s, 200 * 3 * 2e-4, 1e-9);
}

// The thread notes at 0, 5, 10 ms and then, after its CPU stood, at 120 ms.
TEST(StoodTime, IsWhatACpuStoodForAndNothingOfAnAwakeOne) {
  StoodTime stood;
  std::int64_t sum = 0, noted = 0;
  for (std::int64_t now = 0; now < 140 * kMs; now += kPeriod) {
    if (now < 11 * kMs || now >= 120 * kMs) noted = now / (5 * kMs) * (5 * kMs);
    sum += stood.look(now, noted);
    const bool stands = now > 26 * kMs && now < 120 * kMs;
    if (now <= 25 * kMs || stands) {
      EXPECT_EQ(sum, stands ? now - 15 * kMs : 0) << now;
    }
  }
  EXPECT_NEAR(static_cast<double>(sum), 105.0 * kMs, kPeriod);
  // Late by less than the slack, again and again.
  for (std::int64_t now = 140 * kMs; now < 400 * kMs; now += kPeriod) {
    noted = 140 * kMs + (now - 140 * kMs) / (14 * kMs) * (14 * kMs);
    EXPECT_EQ(stood.look(now, noted), 0) << now;
  }
}

TEST(AwakeSilence, IsThatOfAnAwakeCpuAlsoWhereTheListenerStalls) {
  AwakeSilence silence;
  EXPECT_DOUBLE_EQ(silence.take(0.020, 0), 0.020);
  EXPECT_DOUBLE_EQ(silence.take(0.035, 0.010), 0.025);
  EXPECT_DOUBLE_EQ(silence.take(0.150, 0.115), 0.025);
  EXPECT_DOUBLE_EQ(silence.take(0.148, 0), 0.023) << "the listener stalled for 2 ms: no heartbeat";
  EXPECT_DOUBLE_EQ(silence.take(0.240, 0), 0.115) << "the CPU is awake again, and it is silent";
  EXPECT_DOUBLE_EQ(silence.take(0, 0), 0) << "a heartbeat";
  EXPECT_DOUBLE_EQ(silence.take(0.091, 0), 0.091) << "what stood before it does not count";
}

// Time for which a witness of the last CPU says that it stood, while a thread of that priority spins there.
std::int64_t stood_beside(int spinning, int watched) {
  cpu_set_t set;
  sched_getaffinity(0, sizeof set, &set);
  int cpu = CPU_SETSIZE - 1;
  while (cpu > 0 && !CPU_ISSET(cpu, &set)) --cpu;
  CpuWitness witness(cpu, watched);
  std::int64_t stood_ns = -1;
  std::thread([&] {
    pin_to_cpu(cpu);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));  // the witness is there
    sched_param param{};
    param.sched_priority = spinning;
    if (sched_setscheduler(0, SCHED_FIFO, &param) != 0) return;
    stood_ns = 0;
    for (const std::int64_t begun = host_now_ns(); host_now_ns() - begun < 80 * kMs;)
      stood_ns += witness.stood_ns(host_now_ns());
  }).join();
  return stood_ns;
}

TEST(CpuWitness, AWatchedProcessThatSpinsDoesNotMakeItsCpuStand) {
  constexpr int kWatched = 10;
  const std::int64_t beside_stranger = stood_beside(kWatched + 10, kWatched);
  if (beside_stranger < 0) GTEST_SKIP() << "SCHED_FIFO is not allowed here";
  EXPECT_GT(beside_stranger, 50 * kMs);
  // A shared machine can itself stand during one attempt, not during all of them.
  std::int64_t beside_watched = beside_stranger;
  for (int attempt = 0; attempt < 10 && beside_watched >= 20 * kMs; ++attempt)
    beside_watched = stood_beside(kWatched, kWatched);
  EXPECT_LT(beside_watched, 20 * kMs);
}

}  // namespace
}  // namespace twinrate::plant_clock_test
