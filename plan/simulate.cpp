#include "plan/simulate.hpp"

#include <algorithm>
#include <cmath>

#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "trace/measured.hpp"

namespace twinrate {
namespace {

constexpr double kSpeedTolerance = 0.2;    // relative to the reference
constexpr double kConstantFor_s = 0.1;     // hold time after which a reference is constant
constexpr double kCurrentTolerance = 1.3;  // relative to the limit of the bench

// True for a tick that does not follow the plan. Call with every tick in order.
class OffPlan {
 public:
  OffPlan(double i_max, double T_s) : i_max_(i_max), T_s_(T_s) {}
  bool operator()(const TickRecord& tick) {
    const double ref = tick.command.omega_m_ref, omega_m = tick.truth.omega_m;
    if (ref != ref_) ref_ = ref, constant_ = 0;
    constant_ += T_s_;
    const double i = tick.truth.i_dq.norm();
    if (!std::isfinite(i * i) || !std::isfinite(omega_m * omega_m)) return true;
    if (i > kCurrentTolerance * i_max_) return true;
    return ref != 0 && constant_ > kConstantFor_s &&
           std::abs(omega_m - ref) > kSpeedTolerance * std::abs(ref);
  }

 private:
  double i_max_, T_s_, ref_ = 0, constant_ = 0;
};

}  // namespace

PlannedRun simulate_planned(const Config& drive, const std::vector<std::string>& overrides,
                            double i_max, const std::string& what, const PlanHooks& hooks) {
  std::vector<ConfiguredEffect> model_effects;
  for (const ConfiguredEffect& e : drive.drive().effects)
    if (e.used_in != UsedIn::kPlant) model_effects.push_back({e.effect, UsedIn::kBoth, e.from_s});
  Config config = Config::parse(drive.resolved_with(std::move(model_effects)), "plan", overrides);
  read_all_tables(config);
  const DriveConfig& d = config.drive();
  ClosedLoop loop(config);
  DeclaredLoad load(d);
  OffPlan off_plan(i_max, d.T_s());
  PlannedRun run;
  run.raw.path = "the planned run";
  Measurement before;
  const std::int64_t steps = d.steps(), every = std::max<std::int64_t>(1, steps / 200);
  for (std::int64_t k = 0; k < steps; ++k) {
    const TickRecord* tick = nullptr;
    try {
      tick = &loop.step();
    } catch (const std::runtime_error&) {  // from the integrator
      break;
    }
    const Measurement m = tick->measurement;
    if (k > 0) {
      const double T_load = load.at(1e-9 * static_cast<double>(before.t_ns));
      append_row(run.raw, before, m.u_alphabeta, &T_load);
    }
    before = m;
    run.off_plan.push_back(off_plan(*tick));
    if (k > every &&
        std::abs(wrap_pi(tick->estimate.theta_e - d.machine.n_p * tick->truth.theta_m)) > kPi / 2)
      run.filter_lost = true;
    if (k % every != 0) continue;
    if (hooks.progress) hooks.progress(what, static_cast<double>(k) / static_cast<double>(steps));
    if (hooks.stop && hooks.stop()) break;
  }
  return run;
}

}  // namespace twinrate
