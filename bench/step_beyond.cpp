// Policy propagated (estimator/propagated_gain.hpp) in closed loop, compared with n = 1: dynamic
// profile and starts from standstill. Runge-Kutta prediction.
//
//   build/bench/step_beyond [N ..]        default 20 50 100 200 1000
#include <fmt/format.h>

#include <cstdlib>

#include "core/report_error.hpp"
#include "tests/loop/closed_loop.hpp"

namespace twinrate::bench {
namespace {

using test::Overrides;

// Steep ramps and load pulses of 0.8 rated torque; one gain a tick for 0.5 s.
Overrides dynamic_profile() {
  return {"reference.omega_e_rad_s=[[0, 200], [1, 1200], [2, 300]]",
          "reference.slew_rad_s2=4000",
          "load.T_load_Nm=[[0, 0], [1.5, 0.05], [1.8, 0], [2.5, 0.05], [2.8, 0]]",
          "load.slew_Nm_s=0",
          "run.settle_s=0.6",
          "run.duration_s=3.2",
          "rates.n_from=start",
          "rates.n_from_s=0.5"};
}

Overrides standstill(double f_e_Hz, double ramp_rad_s2) {
  const double ready_s = kTwoPi * f_e_Hz / ramp_rad_s2 + 0.5;
  return {fmt::format("reference.omega_e_rad_s={}", kTwoPi * f_e_Hz),
          fmt::format("reference.slew_rad_s2={}", ramp_rad_s2),
          fmt::format("run.settle_s={}", ready_s), fmt::format("run.duration_s={}", ready_s + 1)};
}

// Largest angle error over the seeds, deg.
struct Worst {
  double rms = 0, max = 0;
};
Worst worst(const Overrides& scenario, const std::string& policy, int n, int seeds) {
  Worst figures;
  for (int seed = 1; seed <= seeds; ++seed) {
    Overrides all = scenario;
    all.insert(all.end(), {"estimator.prediction=rk4", "gain.policy=" + policy,
                           fmt::format("rates.n={}", n), fmt::format("run.seed={}", seed)});
    const test::Figures run = test::run("dilys2021", all);
    figures.rms = std::max(figures.rms, test::degrees(run.angle_error_rms));
    figures.max = std::max(figures.max, test::degrees(run.angle_error_max));
  }
  return figures;
}

void row(const std::string& name, const Overrides& scenario, const std::vector<int>& ns) {
  constexpr int kSeeds = 3;
  fmt::print("{:<28} full filter {:6.3f} |", name, worst(scenario, "paper", 1, kSeeds).rms);
  for (int n : ns) {
    const Worst found = worst(scenario, "propagated", n, kSeeds);
    if (found.max > 90)
      fmt::print("  n = {}: lost", n);
    else
      fmt::print("  n = {}: {:.3f} (max {:.1f})", n, found.rms, found.max);
  }
  fmt::print("\n");
}

}  // namespace
}  // namespace twinrate::bench

int main(int argc, char** argv) try {
  using namespace twinrate::bench;
  std::vector<int> ns;
  for (int i = 1; i < argc; ++i) ns.push_back(std::atoi(argv[i]));
  if (ns.empty()) ns = {20, 50, 100, 200, 1000};
  fmt::print("angle error, deg rms, worst of 3 seeds\n");
  row("dynamic profile", dynamic_profile(), ns);
  for (double ramp : {2000.0, 16000.0})
    for (double f_e : {10.0, 63.66, 150.0})
      row(fmt::format("standstill to {:g} Hz, {:g}", f_e, ramp), standstill(f_e, ramp), ns);
} catch (...) {
  return twinrate::report_error("step_beyond");
}
