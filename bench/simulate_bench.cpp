// Speed of one simulated drive, dilys2021 with n = 5: the two halves of the filter, the loop with
// each engine of the plant, a naive loop, and the whole of `twinrate simulate` with log and page.
//
// `drive_s_per_cpu_s`: seconds of drive time for each second of CPU time.
#include <benchmark/benchmark.h>
#include <sys/resource.h>

#include <cstdlib>
#include <filesystem>

#include "bench/naive_loop.hpp"
#include "core/config.hpp"
#include "estimator/make_filter.hpp"
#include "loop/closed_loop.hpp"

namespace twinrate::bench {
namespace {

constexpr int kTicks = 2500;  // 0.5 s
constexpr double kRunAlone_s = 20;

void rate_of(benchmark::State& state, double drive_s) {
  state.counters["drive_s_per_cpu_s"] = benchmark::Counter(
      drive_s * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}

// What the two halves of the filter get, tick by tick.
const std::vector<TickRecord>& recorded() {
  static const std::vector<TickRecord> ticks = [] {
    Config config = Config::load("dilys2021", {"rates.n_from=start"});
    ClosedLoop loop(config);
    std::vector<TickRecord> all;
    all.reserve(kTicks);
    for (int k = 0; k < kTicks; ++k) all.push_back(loop.step());
    return all;
  }();
  return ticks;
}

// FastLoop: one tick, with the gain of every fifth.
void fast_loop(benchmark::State& state) {
  Config config = Config::load("dilys2021", {"rates.n_from=start"});
  FastLoop fast = make_fast_loop(config, false);
  std::size_t k = 0;
  for ([[maybe_unused]] auto _ : state) {
    const TickRecord& tick = recorded()[k];
    benchmark::DoNotOptimize(fast.tick(tick.measurement));
    if (tick.has_gain) fast.take_gain(tick.gain);
    if (++k < recorded().size()) continue;
    if (fast.last_k() != kTicks - 1) state.SkipWithError("not all ticks");
    fast.reset();
    k = 0;
  }
}
BENCHMARK(fast_loop)->Name("half/fast");

// BackgroundLoop: one gain.
void background_loop(benchmark::State& state) {
  Config config = Config::load("dilys2021", {"rates.n_from=start"});
  BackgroundLoop background = make_background_loop(config);
  std::vector<Estimate> snapshots;
  for (const TickRecord& tick : recorded())
    if (tick.has_gain) snapshots.push_back(tick.estimate);
  std::size_t i = 0;
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(background.step(snapshots[i]));
    if (++i < snapshots.size()) continue;
    background.reset();
    i = 0;
  }
}
BENCHMARK(background_loop)->Name("half/background");

void closed_loop(benchmark::State& state, const std::vector<std::string>& overrides) {
  Config config = Config::load("dilys2021", overrides);
  for ([[maybe_unused]] auto _ : state) {
    ClosedLoop loop(config);
    for (int k = 0; k < kTicks; ++k) loop.step();
  }
  rate_of(state, kTicks * kTs);
}
BENCHMARK_CAPTURE(closed_loop, rk, {"plant.engine=rk"})->Name("loop/rk");
BENCHMARK_CAPTURE(closed_loop, erk4, {"plant.engine=erk", "plant.erk_steps=4"})->Name("loop/erk_4");
BENCHMARK_CAPTURE(closed_loop, erk1, {"plant.engine=erk", "plant.erk_steps=1"})->Name("loop/erk_1");
BENCHMARK_CAPTURE(closed_loop, cvode, {"plant.engine=cvode"})->Name("loop/cvode");

void naive_loop(benchmark::State& state) {
  for ([[maybe_unused]] auto _ : state) {
    NaiveLoop loop;
    for (int k = 0; k < kTicks; ++k) loop.step();
    if (std::abs(loop.omega_e() - 400) > 40) state.SkipWithError("not at its speed");
  }
  rate_of(state, kTicks * kTs);
}
BENCHMARK(naive_loop)->Name("loop/naive");

double cpu_s_of_children() {
  rusage used{};
  getrusage(RUSAGE_CHILDREN, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

// CPU time of the program, all of it, in a directory that holds nothing yet.
void simulate(benchmark::State& state, const std::string& options) {
  const auto directory = std::filesystem::temp_directory_path() / "twinrate_simulate_bench";
  const std::string command = std::string(TWINRATE_PROGRAM) + " simulate dilys2021 --duration " +
                              std::to_string(kRunAlone_s) + "s --run-dir " + directory.string() +
                              options + " >/dev/null";
  for ([[maybe_unused]] auto _ : state) {
    std::filesystem::remove_all(directory);
    const double begun = cpu_s_of_children();
    if (std::system(command.c_str()) != 0) state.SkipWithError("simulate failed");
    state.SetIterationTime(cpu_s_of_children() - begun);
  }
  std::filesystem::remove_all(directory);
  rate_of(state, kRunAlone_s);
}
BENCHMARK_CAPTURE(simulate, rk, "")->Name("log_and_page/rk")->UseManualTime()->Iterations(1);
BENCHMARK_CAPTURE(simulate, erk4, " --set plant.engine=erk --set plant.erk_steps=4")
    ->Name("log_and_page/erk_4")
    ->UseManualTime()
    ->Iterations(1);

}  // namespace
}  // namespace twinrate::bench

BENCHMARK_MAIN();
