// Runs STEPS steps of one part of a filter under callgrind; bench/count_instructions takes the
// difference of two runs.
//
//   count_steps PART STEPS      PART: fast background full dq doubled_20 doubled_100 doubled_1000
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "bench/opponents.hpp"
#include "estimator/kernels/riccati_doubling.hpp"

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
  const auto [K, P] = sequential(propagate(f.c, f.x, f.P, f.Q), f.R);
  kernel::DqOutput<double> innov;
  f.x = correct(f.c, predict_euler(f.c, f.x, u_d, u_q), K, y, innov);
  f.P = P;
}

// The gain after that many background steps at constant speed, by doubling; policy propagated needs
// seven in a run.
struct DoubledFilter {
  KernelFilter<double> filter;
  kernel::RiccatiMap<4> map;
  Eigen::Matrix4d P = Eigen::Matrix4d::Identity();
  DoubledFilter() {
    const double turned = 400 * kTs;
    const auto g = jacobian(filter.c, 400.0, kernel::UnitVector<double>{0, 1});
    Eigen::Matrix4d F, back = Eigen::Matrix4d::Identity();
    F << filter.c.d, 0, g.g02, g.g03, 0, filter.c.d, g.g12, g.g13, 0, 0, 1, 0, 0, 0, kTs, 1;
    back.topLeftCorner<2, 2>() << std::cos(turned), std::sin(turned), -std::sin(turned),
        std::cos(turned);
    map = {F * back, Eigen::Vector4d(1, 1, 0, 0).asDiagonal(),
           Eigen::Map<const Eigen::Vector4d>(filter.Q).asDiagonal()};
  }
};
[[gnu::noinline]] void doubled(DoubledFilter& d, int ticks) {
  const Eigen::Matrix4d P =
      kernel::riccati_steps<4>(d.map, d.map.A * d.P * d.map.A.transpose() + d.map.Q, ticks - 1);
  const kernel::Symmetric4<double> P_prior{P(0, 0), P(0, 1), P(0, 2), P(0, 3), P(1, 1),
                                           P(1, 2), P(1, 3), P(2, 2), P(2, 3), P(3, 3)};
  d.filter.K = kernel::gain(P_prior, d.filter.R);
}

double run(std::string_view part, long steps) {
  KernelFilter<double> f;
  DqFilter d;
  DoubledFilter doubling;
  const kernel::UnitVector<double> at{0.6, 0.8};
  const kernel::DqOutput<double> y{0, 1, 5};
  const Sample s{-1.8, 2.4, -0.6, 0.8};
  for (long i = 0; i < steps; ++i) {
    if (part == "fast") fast(f, at, s);
    if (part == "background") background(f, at);
    if (part == "full") full(f, at, s);
    if (part == "dq") dq(d, 0, 4, y);
    if (part == "doubled_20") doubled(doubling, 20);
    if (part == "doubled_100") doubled(doubling, 100);
    if (part == "doubled_1000") doubled(doubling, 1000);
  }
  return f.x.theta_e + f.P.m33 + d.x.omega_m + doubling.filter.K.k20;
}

}  // namespace
}  // namespace twinrate::bench

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  std::printf("%g\n", twinrate::bench::run(argv[1], std::atol(argv[2])));
  return 0;
}
