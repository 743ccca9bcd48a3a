// Speed of the closed loop: the lane engine on each instruction set, one drive at a time, the
// ordinary closed loop, and the whole figure of the paper.
//
// `drive_s_per_cpu_s`: seconds of drive time for each second of CPU time.
#include <benchmark/benchmark.h>

#include "core/paths.hpp"
#include "lanes/engine.hpp"
#include "loop/closed_loop.hpp"

namespace twinrate::bench {
namespace {

struct Drive {
  lanes::LaneSettings settings;
  lanes::Point point;
  Drive() {
    Config config = Config::load("dilys2021", {});
    lanes::lane_settings(config, settings);
    point = lanes::point_of(config.drive());
  }
};
const Drive& drive() {
  static const Drive one;
  return one;
}

// 64 drives that keep synchronism, with noise.
void closed_loop(benchmark::State& state, lanes::Isa isa) {
  if (!lanes::available(isa)) return state.SkipWithError("not on this machine");
  std::vector<lanes::Point> points(64, drive().point);
  for (std::size_t i = 0; i < points.size(); ++i) {
    points[i].seed = i + 1;
    points[i].duration_s = 0.5;
    points[i].settle_s = 0.2;
  }
  std::vector<lanes::PointResult> results(points.size());
  for ([[maybe_unused]] auto _ : state)
    lanes::run_points(drive().settings, points, results, 1, isa);
  state.counters["drive_s_per_cpu_s"] = benchmark::Counter(
      32.0 * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK_CAPTURE(closed_loop, scalar, lanes::Isa::kScalar)->Name("closed_loop/scalar");
BENCHMARK_CAPTURE(closed_loop, avx2, lanes::Isa::kAvx2)->Name("closed_loop/avx2");
BENCHMARK_CAPTURE(closed_loop, avx512, lanes::Isa::kAvx512)->Name("closed_loop/avx512");

// loop/closed_loop.hpp: one drive with plant.engine = "rk", virtual filters and controllers.
void ordinary_closed_loop(benchmark::State& state) {
  Config config = Config::load("dilys2021", {});
  for ([[maybe_unused]] auto _ : state) {
    ClosedLoop loop(config);
    for (int k = 0; k < 2500; ++k) loop.step();
  }
  state.counters["drive_s_per_cpu_s"] = benchmark::Counter(
      0.5 * static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
}
BENCHMARK(ordinary_closed_loop)->Name("closed_loop/ordinary");

// 20 speeds x 60 ratios x 1.5 s of drive time with noise, on `threads` processors: wall time.
void whole_figure(benchmark::State& state, lanes::Isa isa, int threads) {
  if (!lanes::available(isa)) return state.SkipWithError("not on this machine");
  std::vector<lanes::Point> points;
  for (int speed = 1; speed <= 20; ++speed)
    for (int n = 1; n <= 60; ++n) {
      lanes::Point p = drive().point;
      p.omega_e_ref_rad_s = kTwoPi * 10 * speed;
      p.n = n;
      p.duration_s = 1.5;
      p.settle_s = 0.5;
      points.push_back(p);
    }
  std::vector<lanes::PointResult> results(points.size());
  for ([[maybe_unused]] auto _ : state)
    lanes::run_points(drive().settings, points, results, threads, isa);
  state.counters["points"] = static_cast<double>(points.size());
}
BENCHMARK_CAPTURE(whole_figure, avx2, lanes::Isa::kAvx2, 2)
    ->Name("whole_figure/avx2_2_threads")
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_figure, widest, lanes::widest(), 2)
    ->Name("whole_figure/widest_2_threads")
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(whole_figure, widest1, lanes::widest(), 1)
    ->Name("whole_figure/widest_1_thread")
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace twinrate::bench

BENCHMARK_MAIN();
