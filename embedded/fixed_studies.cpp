#include "embedded/fixed_studies.hpp"

#include <fmt/format.h>

#include "analysis/summary.hpp"
#include "embedded/closed_run.hpp"
#include "embedded/fixed_estimator.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

constexpr double kRamp_rad_s2 = 16000;

std::vector<std::string> point(double f_e_Hz, int n, int seed, double T_s) {
  const double settle_s = kTwoPi * f_e_Hz / kRamp_rad_s2 + 0.5;
  return {fmt::format("reference.omega_e_rad_s={}", kTwoPi * f_e_Hz),
          fmt::format("reference.slew_rad_s2={}", kRamp_rad_s2),
          fmt::format("rates.n={}", n),
          "rates.n_from=start",
          fmt::format("run.seed={}", seed),
          fmt::format("run.settle_s={}", settle_s),
          fmt::format("run.duration_s={}", settle_s + std::max({1.0, 5 / f_e_Hz, 3 * n * T_s}))};
}

template <class Estimator>
bool holds(const std::string& drive, double f_e_Hz, int n, int seed) {
  const double T_s = load_drive(drive).drive().T_s();
  Config config = load_drive(drive, point(f_e_Hz, n, seed, T_s));
  Estimator estimator(config);
  const RunLog log = closed_run(config, [&](const Measurement& m) { return estimator.tick(m); });
  return summarise(log, config.drive()).locked.value_or(false);
}

template <class Estimator>
int limit(const std::string& drive, double f_e_Hz, int seeds, int n_cap) {
  for (int n = 1; n <= n_cap; ++n)
    for (int seed = 1; seed <= seeds; ++seed)
      if (!holds<Estimator>(drive, f_e_Hz, n, seed)) return n - 1;
  return n_cap;
}

}  // namespace

LimitPair find_limits(const std::string& drive, double f_e_Hz, int seeds, int n_cap) {
  return {f_e_Hz, limit<Fixed32>(drive, f_e_Hz, seeds, n_cap),
          limit<EstimatorLoop>(drive, f_e_Hz, seeds, n_cap)};
}

std::string standstill(const std::string& drive, double hours) {
  Config config = load_drive(drive, {"reference.omega_e_rad_s=0", "rates.n=1",
                                     fmt::format("run.duration_s={}", 3600 * hours)});
  FixedChecked32 filter(config);
  std::int64_t ticks = 0, trips = 0;
  double fastest = 0;
  run_closed(
      config, [&](const Measurement& m) { return filter.tick(m); },
      [&](const ClosedTick& tick) {
        ++ticks;
        fastest = std::max(fastest, std::abs(tick.estimate.x_hat[2]));
      },
      [&](const EventRecord&) { ++trips; });
  const m3::Clamps c = filter.filter().clamps();
  return fmt::format(
      "{} ticks at standstill ({:.4g} h of drive time): no operation wrapped\n"
      "  clamped             P33 {}, P34 {}, P44 {}, omega {} times\n"
      "  largest |omega_e|   {:.2f} rad/s estimated\n"
      "  trips               {}\n",
      ticks, hours, c.P33, c.P34, c.P44, c.omega, fastest, trips);
}

}  // namespace twinrate
