// Times of filter steps: hand-written, with Eigen, and in lanes.
//
//   bench/run_all runs this with repetitions in random order and takes the best of each, so that
//   other load on the machine affects both sides of a ratio equally.
#include <benchmark/benchmark.h>

#include "bench/opponents.hpp"
#include "lanes/math.hpp"

namespace twinrate::bench {
namespace {

template <class Filter>
void filter_step(benchmark::State& state) {
  Filter filter;
  const auto& input = samples();
  std::size_t k = 0;
  for ([[maybe_unused]] auto _ : state) {
    filter.step(input[k]);
    k = (k + 1) % input.size();
    benchmark::DoNotOptimize(filter.x);
  }
}
constexpr auto kPaper = CovarianceForm::kPaper, kJoseph = CovarianceForm::kJoseph;
constexpr int kAny = Eigen::Dynamic;
BENCHMARK(filter_step<KernelFilter<double, kPaper>>)->Name("step/hand_written/paper");
BENCHMARK(filter_step<KernelFilter<double, kJoseph>>)->Name("step/hand_written/joseph");
BENCHMARK(filter_step<KernelFilter<float, kPaper>>)->Name("step/hand_written_float/paper");
BENCHMARK(filter_step<EigenFilter<4, 2, kPaper>>)->Name("step/eigen_fixed/paper");
BENCHMARK(filter_step<EigenFilter<4, 2, kJoseph>>)->Name("step/eigen_fixed/joseph");
BENCHMARK(filter_step<EigenFilter<kAny, kAny, kPaper>>)->Name("step/eigen_dynamic/paper");
BENCHMARK(filter_step<EigenFilter<kAny, kAny, kJoseph>>)->Name("step/eigen_dynamic/joseph");

void sine_and_cosine_own(benchmark::State& state) {
  double x = 0;
  for ([[maybe_unused]] auto _ : state) {
    const auto [s, c] = math::sincos(x);
    x = 3 + s + c;  // the next one waits for this one, as in the filter
  }
  benchmark::DoNotOptimize(x);
}
BENCHMARK(sine_and_cosine_own)->Name("sincos/own");
void sine_and_cosine_of_the_library(benchmark::State& state) {
  double x = 0;
  for ([[maybe_unused]] auto _ : state) x = 3 + std::sin(x) + std::cos(x);
  benchmark::DoNotOptimize(x);
}
BENCHMARK(sine_and_cosine_of_the_library)->Name("sincos/library");

// The two parts of a step, without sine and cosine.
void fast_part(benchmark::State& state) {
  KernelFilter<double> filter;
  kernel::UnitVector<double> at{0.6, 0.8};
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(at);
    filter.fast(at, samples()[0]);
    benchmark::DoNotOptimize(filter.x);
  }
}
BENCHMARK(fast_part)->Name("part/fast");
void background_part(benchmark::State& state) {
  KernelFilter<double> filter;
  kernel::UnitVector<double> at{0.6, 0.8};
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(at);
    filter.background(at);
    benchmark::DoNotOptimize(filter.P);
  }
}
BENCHMARK(background_part)->Name("part/background");

template <class Update>
void covariance_form(benchmark::State& state, Update update) {
  KernelFilter<double> filter;
  kernel::UnitVector<double> at{0.6, 0.8};
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(at);
    const auto P_prior =
        propagate(filter.c, jacobian(filter.c, filter.x.omega_e, at), filter.P, filter.Q);
    update(filter, P_prior);
    benchmark::DoNotOptimize(filter.P);
    benchmark::DoNotOptimize(filter.K);
  }
}
BENCHMARK_CAPTURE(covariance_form, joseph, [](auto& f, const auto& P_prior) {
  f.K = kernel::gain(P_prior, f.R);
  f.P = posterior_joseph(P_prior, f.K, f.R);
}) -> Name("covariance/joseph");
BENCHMARK_CAPTURE(covariance_form, paper, [](auto& f, const auto& P_prior) {
  f.K = kernel::gain(P_prior, f.R);
  f.P = posterior(P_prior, f.K, f.R);
}) -> Name("covariance/paper");
BENCHMARK_CAPTURE(covariance_form, sequential, [](auto& f, const auto& P_prior) {
  const auto both = kernel::sequential(P_prior, f.R);
  f.K = both.K;
  f.P = both.P;
}) -> Name("covariance/sequential");
void covariance_ud(benchmark::State& state) {
  KernelFilter<double> filter;
  const double P0[4] = {1, 1, 1, 1};
  auto P = kernel::ud_from_diagonal(P0);
  kernel::UnitVector<double> at{0.6, 0.8};
  for ([[maybe_unused]] auto _ : state) {
    benchmark::DoNotOptimize(at);
    P = ud_propagate(filter.c, jacobian(filter.c, filter.x.omega_e, at), P, filter.Q);
    filter.K = ud_gain(P, filter.R);
    benchmark::DoNotOptimize(filter.K);
  }
}
BENCHMARK(covariance_ud)->Name("covariance/ud");

// Background steps in lanes; the time is that of one row of N filters.
template <int N>
void background_lanes(benchmark::State& state) {
  using T = lanes::Lanes<N, struct FilterBench>;
  const KernelFilter<double> f;
  const kernel::UnitVector<T> at{0.6, 0.8};
  kernel::Symmetric4<T> P{1, 0, 0, 0, 1, 0, 0, 1, 0, 1};
  kernel::Gain42<T> K;
  for ([[maybe_unused]] auto _ : state) {
    const auto P_prior = propagate(f.c, jacobian(f.c, T(400), at), P, f.Q);
    K = kernel::gain(P_prior, f.R);
    P = posterior(P_prior, K, f.R);
    benchmark::DoNotOptimize(P);
    benchmark::DoNotOptimize(K);
  }
  state.SetItemsProcessed(state.iterations() * N);
}
BENCHMARK(background_lanes<1>)->Name("lanes/background_x1");
BENCHMARK(background_lanes<4>)->Name("lanes/background_x4");

}  // namespace
}  // namespace twinrate::bench

BENCHMARK_MAIN();
