// The gain of propagated_gain.hpp in the closed loop, beside the full filter (n = 1): the dynamic
// profile, and starts from standstill. Runge-Kutta prediction.
//
//   build/bench/step_beyond [N ..]        default 20 50 100 200
#include <fmt/format.h>

#include <cstdlib>

#include "bench/propagated_gain.hpp"
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
          "rates.n_from_s=0.5"};
}

Overrides standstill(double f_e_Hz, double ramp_rad_s2) {
  const double ready_s = kTwoPi * f_e_Hz / ramp_rad_s2 + 0.5;
  return {fmt::format("reference.omega_e_rad_s={}", kTwoPi * f_e_Hz),
          fmt::format("reference.slew_rad_s2={}", ramp_rad_s2),
          fmt::format("run.settle_s={}", ready_s), fmt::format("run.duration_s={}", ready_s + 1)};
}

struct Result {
  double rms_deg = 0, max_deg = 0;
};

Result run(const Overrides& scenario, int n, int seed) {
  Overrides all = scenario;
  all.insert(all.end(), {"estimator.prediction=rk4", fmt::format("rates.n={}", n),
                         fmt::format("run.seed={}", seed)});
  Config config = test::load("dilys2021", all);
  const DriveConfig& drive = config.drive();
  const auto filter = std::dynamic_pointer_cast<const EkfSensorless>(make_filter(config));
  Plant plant(drive);
  const auto controller = make_controller(config);
  PropagatedGain gains(filter, drive.T_s(), drive.machine.n_p, n, drive.background_rate().from);
  FastState state;
  Estimate estimate;
  double square = 0, largest = 0;
  std::int64_t count = 0;
  for (std::int64_t k = 0; k < drive.steps(); ++k) {
    const Measurement m = plant.sample();
    const Truth truth = plant.truth();
    if (k == 0)
      state = filter->start(m);
    else
      filter->fast_step(state, m, gains.gain_for(k, estimate));
    estimate = filter->output(state, m);
    estimate.k = k;
    estimate.x_hat = state.x_hat;
    gains.take(estimate);
    const Reference reference = drive.reference_at(k);
    plant.take_command(controller->step({m, estimate, reference, &truth}));
    plant.advance();
    if (static_cast<double>(k) * drive.T_s() < drive.run.settle_s) continue;
    const double error = wrap_pi(estimate.theta_e - drive.machine.n_p * truth.theta_m);
    square += error * error;
    largest = std::max(largest, std::abs(error));
    ++count;
  }
  return {test::degrees(std::sqrt(square / static_cast<double>(count))), test::degrees(largest)};
}

void row(const std::string& name, const Overrides& scenario, const std::vector<int>& ns) {
  constexpr int kSeeds = 3;
  double full = 0;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    Overrides all = scenario;
    all.insert(all.end(),
               {"estimator.prediction=rk4", "rates.n=1", fmt::format("run.seed={}", seed)});
    full = std::max(full, test::degrees(test::run("dilys2021", all).angle_error_rms));
  }
  fmt::print("{:<28} full filter {:6.3f} |", name, full);
  for (int n : ns) {
    Result worst;
    for (int seed = 1; seed <= kSeeds; ++seed) {
      const Result result = run(scenario, n, seed);
      worst.rms_deg = std::max(worst.rms_deg, result.rms_deg);
      worst.max_deg = std::max(worst.max_deg, result.max_deg);
    }
    if (worst.max_deg > 90)
      fmt::print("  n = {}: lost", n);
    else
      fmt::print("  n = {}: {:.3f} (max {:.1f})", n, worst.rms_deg, worst.max_deg);
  }
  fmt::print("\n");
}

}  // namespace
}  // namespace twinrate::bench

int main(int argc, char** argv) {
  using namespace twinrate::bench;
  std::vector<int> ns;
  for (int i = 1; i < argc; ++i) ns.push_back(std::atoi(argv[i]));
  if (ns.empty()) ns = {20, 50, 100, 200};
  fmt::print("angle error, deg rms, worst of 3 seeds\n");
  row("dynamic profile", dynamic_profile(), ns);
  for (double ramp : {2000.0, 16000.0})
    for (double f_e : {10.0, 63.66, 150.0})
      row(fmt::format("standstill to {:g} Hz, {:g}", f_e, ramp), standstill(f_e, ramp), ns);
}
