#include "embedded/fixed_studies.hpp"

#include <fmt/format.h>

#include "analysis/summary.hpp"
#include "embedded/closed_run.hpp"
#include "embedded/fixed_estimator.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

constexpr double kRamp_rad_s2 = 16000;

// Settings as in `sweep fb`; switched: 0.2 s at speed with n = 1, then n.
std::vector<std::string> point(const LimitStudy& study, double f_e_Hz, int n, int seed,
                               double T_s) {
  const double at_speed_s = kTwoPi * f_e_Hz / kRamp_rad_s2;
  const double settle_s = at_speed_s + (study.switched ? 0.7 : 0.5);
  return {fmt::format("reference.omega_e_rad_s={}", kTwoPi * f_e_Hz),
          fmt::format("reference.slew_rad_s2={}", kRamp_rad_s2),
          "gain.policy=" + study.policy,
          fmt::format("rates.n={}", n),
          "rates.n_from=start",
          fmt::format("rates.n_from_s={}", study.switched ? at_speed_s + 0.2 : 0),
          fmt::format("run.seed={}", seed),
          fmt::format("run.settle_s={}", settle_s),
          fmt::format("run.duration_s={}", settle_s + std::max({1.0, 5 / f_e_Hz, 3 * n * T_s}))};
}

template <class Estimator>
bool holds(const std::string& drive, const LimitStudy& study, double f_e_Hz, int n, int seed) {
  const double T_s = load_drive(drive).drive().T_s();
  Config config = load_drive(drive, point(study, f_e_Hz, n, seed, T_s));
  Estimator estimator(config);
  const RunLog log = closed_run(config, [&](const Measurement& m) { return estimator.tick(m); });
  return summarise(log, config.drive()).locked.value_or(false);
}

template <class Estimator>
int limit(const std::string& drive, const LimitStudy& study, double f_e_Hz) {
  for (int n = 1; n <= study.n_max; ++n)
    for (int seed = 1; seed <= study.seeds; ++seed)
      if (!holds<Estimator>(drive, study, f_e_Hz, n, seed)) return n - 1;
  return study.n_max;
}

}  // namespace

LimitPair find_limits(const std::string& drive, const LimitStudy& study, double f_e_Hz) {
  return {f_e_Hz, limit<Fixed32>(drive, study, f_e_Hz), limit<EstimatorLoop>(drive, study, f_e_Hz)};
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
