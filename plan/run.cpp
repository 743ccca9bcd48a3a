#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "plan/outside.hpp"
#include "plan/trial.hpp"
#include "trace/residual_structure.hpp"

namespace twinrate {
namespace {

constexpr double kMaxRun_s = 600;  // an effect not identifiable in this time is reported as such
constexpr double kHoldout = 0.25;
// In a shorter run the blocks of training and held-out rows are too short for the tracer's noise
// model, even if the information is sufficient (loads of 50 and 150 mNm on the example of
// docs/plan-a-measurement.md, 2026-11: none found in 1 s, all in 1.8 s).
constexpr double kMinRun_s = 2;
constexpr double kMaxLog_s = 60;     // an excerpt of a longer log is used
constexpr double kAliasSine = 0.01;  // below: the other effect is an alias at every operating point

Information total(const std::vector<Information>& pieces, Eigen::Index P) {
  Information sum = Information::none(P);
  for (const Information& piece : pieces) sum += piece;
  return sum;
}

Bench bench_for(const DriveConfig& drive, const PlanRequest& r) {
  if (r.i_max_A < 0 || r.speed_max_rpm < 0 || !(r.longest_s > 0))
    throw BadInput("--plan: --duration, --max-speed and --max-current must be positive");
  Bench b = bench_of(drive, r.i_max_A);
  if (r.speed_max_rpm > 0) b.omega_m_max = std::min(b.omega_m_max, r.speed_max_rpm * kTwoPi / 60);
  if (r.T_load_max_Nm >= 0) b.T_load_max = r.T_load_max_Nm;
  if (!r.load_machine) b.T_load_max = 0;
  b.reverse = r.reverse;
  if (!(b.i_max > 0))
    throw BadInput(
        "--plan: the drive file has neither machine.i_rated_A nor machine.T_rated_Nm; "
        "give --max-current");
  return b;
}

// Kinds that are not identifiable and pairs that are not separated in kMaxRun_s of all blocks.
std::vector<NotSeparated> never(const Information& all_blocks, double seconds,
                                const PlanCandidates& candidates) {
  const auto longest = outlook(kMaxRun_s / seconds * all_blocks, candidates);
  std::vector<NotSeparated> list;
  for (std::size_t a = 0; a < longest.size(); ++a) {
    if (!longest[a].identifiable()) {
      list.push_back({candidates.kinds[a], "",
                      longest[a].alone > 0
                          ? fmt::format("ten minutes of every block give {:.2g} sigmas of the "
                                        "smallest size worth reporting",
                                        longest[a].alone)
                          : "no block of this bench excites it"});
      continue;
    }
    for (std::size_t b = 0; b < longest.size(); ++b) {
      if (b == a || longest[a].clear[b] >= kEnoughSigmas) continue;
      std::string why = longest[a].sine[b] < kAliasSine
                            ? fmt::format("{} has the same residual at every operating point",
                                          candidates.kinds[b])
                            : fmt::format("{} explains all but {:.2g} % of it in every block",
                                          candidates.kinds[b], 100 * longest[a].sine[b]);
      const std::string remedy = beyond_a_run({candidates.kinds[a], candidates.kinds[b]});
      if (!remedy.empty()) why += "; remedy: " + remedy;
      list.push_back({candidates.kinds[a], candidates.kinds[b], why});
    }
  }
  return list;
}

std::string sentence(const Plan& plan) {
  const auto count = [](const std::vector<KindOutlook>& all, bool (KindOutlook::*is)() const) {
    return std::count_if(all.begin(), all.end(), [&](const KindOutlook& k) { return (k.*is)(); });
  };
  if (plan.order.empty())
    return plan.log.empty() ? "No run of this bench and length shows any of these effects."
                            : "No run of this bench and length adds to the log.";
  std::string text = fmt::format(
      "A run of {:.4g} s shows {} of {} kinds of effects at the smallest size worth reporting and "
      "separates {} of them from every other kind",
      plan.profile.duration_s, count(plan.after, &KindOutlook::identifiable), plan.kinds.size(),
      count(plan.after, &KindOutlook::separated));
  if (!plan.log.empty())
    text += fmt::format("; the log alone shows {} and separates {}",
                        count(plan.log, &KindOutlook::identifiable),
                        count(plan.log, &KindOutlook::separated));
  return text + ".";
}

// Simulates the whole run and adds its information to `sum`; false if stopped.
bool check_run(const Config& drive, Plan& plan, const std::set<std::string>& kinds,
               const PlanHooks& hooks, Information& sum) {
  const DriveConfig& d = drive.drive();
  if (hooks.stop && hooks.stop()) return false;
  const PlannedRun run =
      simulate_planned(drive, plan.overrides, plan.bench.i_max, "checking the whole run", hooks);
  if (hooks.stop && hooks.stop()) return false;
  const PlanLog log = record_of(run.raw, d.machine.n_p);
  for (const Information& piece :
       plan_information(log.record, log.health, d, kinds,
                        training_spans(log.record, kHoldout, d.machine.n_p))
           .pieces)
    sum += piece;
  if (run.filter_lost)
    plan.notes.push_back(
        fmt::format("the filter {} loses the angle in this run; the controller uses the measured "
                    "angle, and LOST in the summary refers to the filter",
                    d.estimator.kind));
  return true;
}

void note_ideal_sensors(const SensorParameters& sensors, Plan& plan) {
  std::vector<std::string> ideal;
  if (sensors.i_noise_rms == 0 && sensors.i_lsb == 0) ideal.push_back("currents without noise");
  if (sensors.encoder_counts == 0) ideal.push_back("an angle without steps");
  if (!ideal.empty())
    plan.notes.push_back(fmt::format(
        "the drive file declares {}: real sensors ([sensors]) reach less than these figures",
        fmt::join(ideal, " and ")));
}

void check_request(const PlanRequest& request, const Bench& bench) {
  const std::vector<std::string> possible = plannable_kinds(),
                                 &outside = kinds_outside_the_design();
  std::size_t to_tell_apart = 0;
  for (const std::string& kind : request.kinds) {
    if (std::find(outside.begin(), outside.end(), kind) != outside.end()) continue;
    ++to_tell_apart;
    if (std::find(possible.begin(), possible.end(), kind) == possible.end())
      throw BadInput(fmt::format("--kinds {}: one of {}, {} allowed", kind,
                                 fmt::join(possible, ", "), fmt::join(outside, ", ")));
  }
  if (!request.kinds.empty() && to_tell_apart < 2)
    throw BadInput(fmt::format(
        "--kinds: at least two kinds to separate ({} do not count); the default is all kinds",
        fmt::join(outside, ", ")));
  double shortest_s = 1e300;
  for (const PlanBlock& b : building_blocks(bench)) shortest_s = std::min(shortest_s, b.duration_s);
  if (shortest_s > request.longest_s)
    throw BadInput(
        fmt::format("--duration {:.3g}s: the shortest block of this bench takes {:.3g} s",
                    request.longest_s, shortest_s));
}

void note_unfit(const Trial& trial, Plan& plan) {
  std::vector<std::string> names;
  for (std::size_t b : trial.unfit) names.push_back(trial.all[b].name);
  if (!names.empty())
    plan.notes.push_back(
        fmt::format("blocks left out, because the simulated drive does not follow them: {}",
                    fmt::join(names, ", ")));
}

Information of_logs(const std::vector<PlanLog>& logs, const DriveConfig& d,
                    const std::set<std::string>& kinds, Eigen::Index columns,
                    const PlanHooks& hooks) {
  Information sum = Information::none(columns);
  for (const PlanLog& log : logs) {
    if (hooks.progress) hooks.progress("information of the log", 0);
    double part = 1;
    const Record some = excerpt(log.record, kMaxLog_s, part);
    sum += 1 / part *
           total(plan_information(some, log.health, d, kinds,
                                  training_spans(some, kHoldout, d.machine.n_p))
                     .pieces,
                 columns);
  }
  return sum;
}

// Sets plan.order; returns the information of `start` and the chosen blocks.
Information choose_blocks(const Trial& trial, const PlanInformation& blocks,
                          const Information& start, const PlanHooks& hooks, Plan& plan) {
  std::vector<PlanPiece> pieces;
  for (std::size_t j = 0; j < trial.blocks.size(); ++j)  // a share of every run is held out
    pieces.push_back({(1 - kHoldout) * blocks.pieces[j], plan.blocks[trial.blocks[j]].duration_s});
  PlanSettings settings{.longest_s = plan.request.longest_s};
  // A stop before the choice ended the trial early: the choice is then completed.
  if (!(hooks.stop && hooks.stop())) settings.stop = hooks.stop;
  double chosen_s = 0;
  settings.say = [&](std::size_t j, double) {
    chosen_s += pieces[j].duration_s;
    if (hooks.progress) hooks.progress("choosing", chosen_s / plan.request.longest_s);
  };
  Information sum = start;
  double length_s = 0;
  const auto take = [&](std::size_t j) {
    plan.order.push_back(trial.blocks[j]);
    sum += pieces[j].information;
    length_s += pieces[j].duration_s;
  };
  if (const auto shows_gap = block_for_backlash(plan.request, trial.all, trial.blocks)) {
    const auto place = std::find(trial.blocks.begin(), trial.blocks.end(), *shows_gap);
    take(static_cast<std::size_t>(place - trial.blocks.begin()));
    settings.longest_s -= length_s;
  }
  const Information before = sum;
  for (std::size_t j : choose(pieces, before, blocks.candidates, settings)) take(j);
  // Repeats the chosen blocks up to the minimum length for the tracer.
  for (std::size_t n = 0; n < plan.order.size() && length_s < kMinRun_s; ++n) {
    const auto place = std::find(trial.blocks.begin(), trial.blocks.end(), plan.order[n]);
    const auto j = static_cast<std::size_t>(place - trial.blocks.begin());
    if (length_s + pieces[j].duration_s <= plan.request.longest_s) take(j);
  }
  return sum;
}

// Removes from plan.never the effects that the whole run does show: the short blocks hid them in
// noise.
void correct_by_run(Plan& plan) {
  const auto index = [&](const std::string& kind) {
    return static_cast<std::size_t>(std::find(plan.kinds.begin(), plan.kinds.end(), kind) -
                                    plan.kinds.begin());
  };
  std::erase_if(plan.never, [&](const NotSeparated& n) {
    const KindOutlook& k = plan.after[index(n.a)];
    return n.b.empty() ? k.identifiable() : k.clear[index(n.b)] >= kEnoughSigmas;
  });
}

}  // namespace

Plan make_plan(const Config& drive, const PlanRequest& request, const std::vector<PlanLog>& logs,
               const PlanHooks& hooks) {
  const DriveConfig& d = drive.drive();
  Plan plan{.request = request, .bench = bench_for(d, request)};
  check_request(request, plan.bench);
  const std::set<std::string> kinds(request.kinds.begin(), request.kinds.end());

  const Trial trial = try_blocks(drive, plan.bench, hooks);
  plan.blocks = trial.all;
  note_unfit(trial, plan);
  if (hooks.progress) hooks.progress("information of the blocks", 0);
  const PlanInformation blocks =
      plan_information(trial.log.record, trial.log.health, d, kinds, trial.spans);
  const PlanCandidates& candidates = blocks.candidates;
  plan.kinds = candidates.kinds;
  double tried_s = 0;
  for (std::size_t b : trial.blocks) tried_s += plan.blocks[b].duration_s;
  plan.never = never(total(blocks.pieces, candidates.columns), tried_s, candidates);

  const Information start = of_logs(logs, d, kinds, candidates.columns, hooks);
  if (!logs.empty()) plan.log = outlook(start, candidates);
  Information after = start;
  const Information estimate = choose_blocks(trial, blocks, start, hooks, plan);
  plan.profile = assemble(plan.blocks, plan.order);
  if (!plan.order.empty()) {
    plan.overrides = overrides_of(d, plan.bench, plan.profile);
    plan.checked = check_run(drive, plan, kinds, hooks, after);
  }
  plan.after = outlook(plan.checked ? after : estimate, candidates);
  correct_by_run(plan);
  plan.outside = outside_the_design(plan, logs, d);
  note_ideal_sensors(d.sensors, plan);
  plan.sentence = sentence(plan);
  return plan;
}

}  // namespace twinrate
