// STEPS steps of one part of a filter, for callgrind: bench/count_instructions takes the difference
// of two runs.
//
//   count_steps PART STEPS      PART: fast background full dq
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "bench/opponents.hpp"

namespace twinrate::bench {
namespace {

[[gnu::noinline]] void fast(KernelFilter<double>& f, const kernel::UnitVector<double>& at,
                            const Sample& s) {
  f.fast(at, s);
}
[[gnu::noinline]] void background(KernelFilter<double>& f, const kernel::UnitVector<double>& at) {
  f.background(at);
}
[[gnu::noinline]] void full(KernelFilter<double>& f, const kernel::UnitVector<double>& at,
                            const Sample& s) {
  f.background(at);
  f.fast(at, s);
}

struct DqFilter {
  kernel::DqConstants<double> c =
      kernel::dq_constants<double>(1.05, 9.5e-3, 11e-3, 0.2533, 8.8e-3, 3, -700, 1e-4);
  double Q[4] = {1, 2, 1.5, 0.1}, R[3] = {10, 10, 150};
  kernel::DqState<double> x{0, 1, 5, 0};
  kernel::Symmetric4<double> P{1, 0, 0, 0, 1, 0, 0, 1, 0, 1};
};
[[gnu::noinline]] void dq(DqFilter& f, double u_d, double u_q, const kernel::DqOutput<double>& y) {
  const auto step = sequential(propagate(f.c, f.x, f.P, f.Q), f.R);
  f.P = step.P;
  kernel::DqOutput<double> innov;
  f.x = correct(f.c, predict_euler(f.c, f.x, u_d, u_q), step.K, y, innov);
}

double run(std::string_view part, long steps) {
  KernelFilter<double> f;
  DqFilter d;
  const kernel::UnitVector<double> at{0.6, 0.8};
  const kernel::DqOutput<double> y{0, 1, 5};
  const Sample s{-1.8, 2.4, -0.6, 0.8};
  for (long i = 0; i < steps; ++i) {
    if (part == "fast") fast(f, at, s);
    if (part == "background") background(f, at);
    if (part == "full") full(f, at, s);
    if (part == "dq") dq(d, 0, 4, y);
  }
  return f.x.theta_e + f.P.m33 + d.x.omega_m;
}

}  // namespace
}  // namespace twinrate::bench

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  std::printf("%g\n", twinrate::bench::run(argv[1], std::atol(argv[2])));
  return 0;
}
