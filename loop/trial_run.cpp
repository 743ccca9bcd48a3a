#include "loop/trial_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "core/reason.hpp"
#include "estimator/gain_schedule.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/tracing.hpp"
#include "model/frames.hpp"
#include "plant_sim/plant_parameters.hpp"

namespace twinrate {
namespace {

bool finite(const TickRecord& t) {
  return std::isfinite(t.truth.omega_m * t.truth.omega_m) && t.truth.i_dq.allFinite() &&
         std::isfinite(t.estimate.theta_e) && std::isfinite(t.estimate.omega_m) &&
         t.estimate.x_hat.allFinite();
}

std::string trip_of(const TickRecord& tick) {
  if (is_trip(tick.event.reason)) return tick.event.text;
  for (const PlantEvent& event : tick.plant_events)
    if (is_trip(event.reason)) return event.text;
  return "";
}

// Angle forced by the start.
bool is_forced(Mode mode) {
  return mode == Mode::kAlign || mode == Mode::kIfRamp;
}

// 0.02 to 0.25 s: the loop takes 0.4 to 5 us a tick.
constexpr std::int64_t kTrialTicks = 60000;
// The switched inverter and SUNDIALS are integrated in small steps, so the trial has fewer ticks:
// some ten segments of each switching period, each in `erk_steps`.
std::int64_t ticks_of_trial(Config& config) {
  const auto plant = config.read<PlantParameters>();
  const bool switched = plant.inverter == InverterModel::kSwitched;
  if (!switched && plant.engine == Engine::kRk) return kTrialTicks;
  const DriveConfig& d = config.drive();
  const double steps = (switched ? 10 * d.facts().f_pwm * d.T_s() : 1.0) *
                       (plant.engine == Engine::kErk ? plant.erk_steps : 1.0);
  return std::max<std::int64_t>(1, std::llround(kTrialTicks / std::max(10.0, steps)));
}

// 0.1 to 0.7 s: a background step takes 5 to 70 ns for each element of P (4 to 20 states, -O3).
constexpr std::int64_t kTrialTableElements = 10'000'000;
// The gains over speed that the run uses, if any. Empty if they take too long.
std::optional<GainTable> table_of_trial(Config& config) {
  if (!uses_table(config)) return GainTable();
  const std::shared_ptr<const Filter> filter = make_filter(config);
  if (!filter->steady_state(0)) return GainTable();
  const int n_x = filter->initial_gain().n_x;
  GainTable table = GainSchedule::build(*filter, config.drive().omega_m_limit(),
                                        kTrialTableElements / (n_x * n_x));
  if (!table) return std::nullopt;
  return table;
}

// A run that this process can repeat within a second.
bool can_be_tried(Config& config) {
  const DriveConfig& d = config.drive();
  return d.plant.kind == PlantKind::kSimulated && !d.reference.from_bus;
}

// The same drive with a plant whose winding is 50 K warmer; the model keeps machine.R_s.
Config with_warm_winding(const Config& config) {
  const std::shared_ptr<Effect> resistance = make_resistance();
  const double change = kResistanceError * config.drive().machine.R_s;
  resistance->tracing().set_coefficients({&change, 1});
  std::vector<ConfiguredEffect> effects = config.drive().effects;
  effects.push_back({resistance, UsedIn::kPlant});
  Config warm = Config::parse(config.resolved_with(std::move(effects)), "trial");
  read_all_tables(warm);
  return warm;
}

// The gains of a table are the settled ones of a gain every tick.
TrialRun try_ordinary(const Config& config, std::int64_t ticks) {
  Config ordinary = Config::parse(
      config.resolved(), "trial",
      {"gain.policy=paper", "rates.n=1", "steering.policy=gain.policy", "steering.n=0"});
  read_all_tables(ordinary);
  return try_run(ordinary, ticks);
}

std::string text_of(const TrialRun& trial) {
  return fmt::format("{} at {:.4g} s: {}", trial.tripped ? "trips" : "loses synchronism",
                     trial.bad_at_s, trial.why);
}

}  // namespace

TrialRun try_run(Config& config, std::int64_t ticks, const GainTable& table) {
  const DriveConfig d = config.drive();
  ClosedLoop loop(config, make_filter, table);
  TrialRun trial;
  const std::int64_t steps = std::min(ticks, d.steps());
  bool forced = false, was_forced = d.start != Start::kAlignIf;
  double passed_at_s = -1;  // first angle error beyond 90 deg
  while (loop.k() < steps) {
    const TickRecord& tick = loop.step();
    const double t = d.T_s() * static_cast<double>(tick.measurement.k);
    trial.why = trip_of(tick);
    trial.tripped = !trial.why.empty();
    forced = is_forced(tick.measurement.mode);
    was_forced = was_forced || forced;
    double bad_at_s = t;
    if (!trial.tripped && was_forced && !forced) {
      const double error = wrap_pi(tick.estimate.theta_e - d.machine.n_p * tick.truth.theta_m);
      const bool passed = std::abs(error) > kPi / 2;
      if (passed && passed_at_s < 0) passed_at_s = t;
      if (t < d.run.settle_s - 1e-9) continue;
      if (!finite(tick)) {
        trial.why = "a state is not finite";
      } else if (passed) {
        // Judged in the window; the time is that of the run's verdict.
        trial.why = "the angle error passed 90 deg";
        bad_at_s = passed_at_s;
      }
    }
    if (trial.why.empty()) continue;
    trial.bad_at_s = bad_at_s;
    return trial;
  }
  trial.whole = steps == d.steps();
  if (trial.whole && forced) {
    trial.bad_at_s = d.T_s() * static_cast<double>(steps);
    trial.why = "no hand-over to the estimate before the end";
  }
  return trial;
}

// The warnings that the trials do not refute; a note for each of the others.
static std::vector<Warning> not_refuted(std::vector<Warning> warnings, const DriveConfig& d,
                                        std::int64_t ticks, const TrialRun& trial,
                                        const TrialRun& of_warm, std::vector<std::string>* notes) {
  const double tried_s = d.T_s() * static_cast<double>(std::min(ticks, d.steps()));
  std::vector<Warning> left;
  for (Warning& w : warnings) {
    const bool decided = trial.whole || w.shows_by_s <= tried_s;
    if (decided && (w.expects == Expects::kLoss ||
                    (w.expects == Expects::kLossIfWarm && of_warm.bad_at_s < 0))) {
      if (notes)
        notes->push_back(fmt::format(
            "{}; a trial of {} keeps synchronism, with seed {} alone", w.text,
            trial.whole ? "this run" : fmt::format("the first {:.3g} s", tried_s), d.run.seed));
      continue;
    }
    if (decided && w.expects == Expects::kLossIfWarm) {
      w.text += fmt::format("; a trial with the winding 50 K warmer {}", text_of(of_warm));
    }
    left.push_back(std::move(w));
  }
  return left;
}

std::vector<std::string> check_by_trial(Config& config, Trial when,
                                        std::vector<std::string>* notes) {
  std::vector<Warning> warnings = check_runnable(config);
  const auto expects = [&](Expects what) {
    return std::any_of(warnings.begin(), warnings.end(),
                       [what](const Warning& w) { return w.expects == what; });
  };
  const bool warm = expects(Expects::kLossIfWarm), loss = warm || expects(Expects::kLoss);
  if (!can_be_tried(config) || (when == Trial::kOfReasons && !loss)) return texts_of(warnings);
  const std::int64_t ticks = ticks_of_trial(config);
  const std::optional<GainTable> table = table_of_trial(config);
  const bool as_it_is = table.has_value();
  const TrialRun trial = as_it_is ? try_run(config, ticks, *table) : try_ordinary(config, ticks);
  const bool bad = trial.bad_at_s >= 0;
  if (bad && !loss)
    warnings.push_back(
        {fmt::format("{}: run.duration_s: a trial of the run{} {}", config.where("run.duration_s"),
                     as_it_is ? "" : " with a gain every tick", text_of(trial)),
         Expects::kLoss});
  if (bad || !as_it_is) return texts_of(warnings);
  TrialRun of_warm = trial;
  if (warm && trial.whole) {
    Config other = with_warm_winding(config);
    of_warm = try_run(other, ticks, *table);  // the filter is the same
  }
  return texts_of(not_refuted(std::move(warnings), config.drive(), ticks, trial, of_warm, notes));
}

}  // namespace twinrate
