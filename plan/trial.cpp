#include "plan/trial.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace twinrate {
namespace {

constexpr int kMaxSlowDowns = 2;  // of the bench

std::string steps_text(const std::vector<ProfileStep>& steps, double factor) {
  std::string text;
  for (const ProfileStep& step : steps)
    text +=
        fmt::format("{}[{:.6g}, {:.6g}]", text.empty() ? "" : ", ", step.t_s, factor * step.value);
  return "[" + text + "]";
}

Trial try_once(const Config& drive, const Bench& bench, const PlanHooks& hooks) {
  constexpr double kMaxOffPlan_s = 2e-3;  // in a block
  const DriveConfig& d = drive.drive();
  Trial trial{.log = {}, .all = building_blocks(bench)};
  std::vector<std::size_t> every(trial.all.size());
  std::iota(every.begin(), every.end(), std::size_t{0});
  const PlanProfile pool = assemble(trial.all, every);
  const PlannedRun run = simulate_planned(drive, overrides_of(d, bench, pool), bench.i_max,
                                          "trying the building blocks", hooks);
  for (std::size_t b : every) {
    const auto row = [&](double t) { return static_cast<std::size_t>(std::lround(t / d.T_s())); };
    const RowSpan span{row(pool.start_s[b]), row(pool.start_s[b] + trial.all[b].duration_s) - 1};
    if (span.last + 1 > run.raw.t.size()) break;  // stopped
    const auto off = std::count(run.off_plan.begin() + static_cast<std::ptrdiff_t>(span.first),
                                run.off_plan.begin() + static_cast<std::ptrdiff_t>(span.last), 1);
    if (static_cast<double>(off) * d.T_s() > kMaxOffPlan_s) {
      trial.unfit.push_back(b);
      continue;
    }
    trial.blocks.push_back(b);
    trial.spans.push_back(span);
  }
  if (!trial.blocks.empty()) trial.log = record_of(run.raw, d.machine.n_p);
  return trial;
}

// Halves the speed ramps if more than a third of the blocks without load is unfit; makes the load
// smaller and slower if more than a third of the blocks with load is. False: no change.
bool slow_down(Bench& bench, const Trial& trial) {
  const auto loaded = [&](std::size_t b) { return trial.all[b].T_load.size() > 1; };
  std::size_t all[2] = {0, 0}, bad[2] = {0, 0};
  for (std::size_t b = 0; b < trial.all.size(); ++b) ++all[loaded(b)];
  for (std::size_t b : trial.unfit) ++bad[loaded(b)];
  if (3 * bad[0] > all[0]) bench.slew /= 2;
  if (3 * bad[1] > all[1]) {
    bench.load_slew /= 4;
    bench.T_load_max *= 0.7;
  }
  return 3 * bad[0] > all[0] || 3 * bad[1] > all[1];
}

}  // namespace

std::vector<std::string> overrides_of(const DriveConfig& drive, const Bench& bench,
                                      const PlanProfile& profile) {
  const double n_p = drive.machine.n_p;
  return {drive.reference.in_rpm ? "reference.speed_rpm=" + steps_text(profile.omega_m, 60 / kTwoPi)
                                 : "reference.omega_e_rad_s=" + steps_text(profile.omega_m, n_p),
          fmt::format("reference.slew_rad_s2={:.6g}", n_p * bench.slew),
          "reference.i_d_A=" + steps_text(profile.i_d, 1),
          "reference.from_bus=false",
          "load.T_load_Nm=" + steps_text(profile.T_load, 1),
          fmt::format("load.slew_Nm_s={:.6g}", bench.load_slew),
          fmt::format("run.duration_s={:.6g}", profile.duration_s),
          fmt::format("run.settle_s={:.6g}", std::min(0.5, 0.1 * profile.duration_s)),
          "start=aligned",
          "controller.angle_source=measured"};
}

PlanLog record_of(const RawLog& raw, int n_p) {
  PlanLog log;
  try {
    log.record = make_record(raw, n_p, log.health);
  } catch (const std::runtime_error& error) {
    throw BadInput(error.what());
  }
  return log;
}

Trial try_blocks(const Config& drive, Bench& bench, const PlanHooks& hooks) {
  const auto stopped = [&] { return hooks.stop && hooks.stop(); };
  Trial trial = try_once(drive, bench, hooks);
  for (int n = 0; n < kMaxSlowDowns && !stopped() && slow_down(bench, trial); ++n)
    trial = try_once(drive, bench, hooks);
  if (trial.blocks.empty())
    throw BadInput(stopped() ? "--plan: interrupted before the first block was tried"
                             : "--plan: the drive as it is declared follows none of the blocks; "
                               "does `twinrate simulate` of it run?");
  return trial;
}

}  // namespace twinrate
