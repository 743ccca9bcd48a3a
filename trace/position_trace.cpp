#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "model/frames.hpp"
#include "trace/consistency.hpp"
#include "trace/fall.hpp"
#include "trace/holding_gate.hpp"
#include "trace/measured_result.hpp"
#include "trace/position_effects.hpp"
#include "trace/position_gate.hpp"
#include "trace/position_pictures.hpp"
#include "trace/verdict.hpp"

namespace twinrate {
namespace {

void add_errors(const Found& found, const Judge& judge, TraceResult& r) {
  const Errors train = judge.over(found, found.model(), false);
  const Errors unseen = judge.over(found, found.model(), true);
  const auto rms = [](double sum, const Errors& e) { return Errors::rms(sum, e.rows); };
  EquationError e{.unit = judge.by_speed() ? "rad/s" : "A",
                  .before = {rms(train.before, train), rms(unseen.before, unseen)},
                  .after = {rms(train.after, train), rms(unseen.after, unseen)}};
  const Errors& shown = unseen.rows > 0 ? unseen : train;
  e.no_change = rms(shown.no_change, shown);
  e.noise_floor = e.whiteness_p_value = kNoError;
  e.rows = static_cast<std::size_t>(shown.rows);
  r.mechanical = e;
  r.main_equation = "mechanical";
  r.horizon_s = judge.horizon();
  for (const PositionLog* log : judge.logs()) {
    if (!std::isfinite(shown.after)) break;  // stopped
    for (const bool held_out : {false, true}) {
      if (log->judges.empty() && log->held_out != held_out) continue;
      Errors own;
      judge.add(*log, held_out, found, found.model(), own);
      r.files.push_back({log->path, held_out, e.unit, static_cast<std::size_t>(own.rows),
                         rms(own.no_change, own), rms(own.before, own), rms(own.after, own)});
    }
  }
}

double turns_covered(const Logs& logs) {
  double most = 0;
  for (const PositionLog* log : logs) {
    const auto [low, high] = std::minmax_element(log->theta_m.begin(), log->theta_m.end());
    most = std::max(most, (*high - *low) / kTwoPi);
  }
  return most;
}

std::string sentence(const TraceResult& r, const Found& found, const Judge& judge) {
  std::vector<std::string> parts;
  if (!found.holding.cogging.empty()) {
    std::vector<int> orders;
    for (const Harmonic& h : found.holding.cogging) orders.push_back(h.order);
    const std::size_t shown = std::min<std::size_t>(orders.size(), 6);
    parts.push_back(fmt::format(
        "cogging of order {}{}",
        fmt::join(orders.begin(), orders.begin() + static_cast<std::ptrdiff_t>(shown), ", "),
        orders.size() > shown ? fmt::format(" and {} more", orders.size() - shown) : ""));
  }
  for (const TracedEffect& e : r.effects) {
    if (e.effect->kind() == "cogging") continue;
    if (e.effect->kind() == "coulomb_friction")
      parts.push_back(fmt::format("Coulomb friction {:.2f} mNm", 1e3 * found.T_C()));
    else if (is_of(*e.effect, Traits::Family::kLag))
      parts.push_back(
          e.only_in_log
              ? fmt::format("a filter of {:.0f} ms in the logged current", 1e3 * found.holding.lag)
              : fmt::format("a lag of {:.2f} ms in the logged speed", 1e3 * found.speed_lag.lag()));
    else
      parts.emplace_back(e.effect->kind());
  }
  const EquationError& e = *r.mechanical;
  const bool unseen = std::isfinite(e.after.held_out);
  const double before = unseen ? e.before.held_out : e.before.train;
  const double after = unseen ? e.after.held_out : e.after.train;
  const std::string of =
      judge.by_speed() ? fmt::format("of the speed change over {:.3g} ms", 1e3 * judge.horizon())
                       : std::string("of the holding current");
  const std::string what =
      parts.empty()
          ? r.ambiguous.empty() ? nothing_in_words(r) : "No effect is found that can be told apart"
          : fmt::format("The model lacks {}", fmt::join(parts, ", "));
  if (!std::isfinite(after)) return what + ".";
  if (const auto falls = fall_in_words(before, after, e.unit))
    return fmt::format("{}. The error {} on {} data {} (no change: {:.3g}).", what, of,
                       unseen ? "held-out" : "fitted", *falls, e.no_change);
  return fmt::format("{}. The error {} on {} data is {:.3g} {} (no change: {:.3g}).", what, of,
                     unseen ? "held-out" : "fitted", after, e.unit, e.no_change);
}

// The reason why a finding is not reported; without the finding itself.
std::string refused_in_words(const Refused& first) {
  return fmt::format("{}: what was found in these logs did not pass the rule of {}{}: {}.",
                     first.rule == "whole" ? "Unexplained" : "Cannot tell", first.rule,
                     first.file.empty() ? "" : " on " + first.file, first.text);
}

// The reason why these logs do not show whether anything is missing: no effect was found, and
// nearly the whole error remains, above the noise of the rows. Empty: they show it.
std::string nothing_explained(const TraceResult& r, const Judge& judge) {
  constexpr double kAll = 0.9, kNoise = 1.5;
  const EquationError& e = *r.mechanical;
  const double after = std::isfinite(e.after.held_out) ? e.after.held_out : e.after.train;
  double noise = 0;
  for (const PositionLog* log : judge.logs()) noise = std::max(noise, row_noise(log->i_q));
  const bool explained = after < kAll * e.no_change;
  if (explained || (!judge.by_speed() && after < kNoise * noise)) return {};
  return fmt::format(
      "Cannot tell: the model does not explain {} ({:.3g} {} without a model, {:.3g} with it), and "
      "these logs do not show the cause. Record i_d, i_q, u_d, u_q and theta_m at the rate of the "
      "current controller (twinrate trace --plan proposes a run).",
      judge.by_speed() ? "the change of the speed" : "the holding current", e.no_change, e.unit,
      after);
}

// Findings from the logs in motion: from the current and from the driver's speed.
void find_in_motion(const MachineParameters& machine, const TraceHooks& hooks, Found& found) {
  found.spin = fit_spin_up(found.in_motion, machine);
  hooks.checkpoint();
  bool of_current = found.holding.lag > 0;
  if (of_current && found.spin.gain > 0) {
    // If the current moves the rotor without that lag, a slow controller caused it.
    const SpinUp late = fit_spin_up(found.in_motion, machine, found.holding.lag);
    of_current = late.rest / late.variation < found.spin.rest / found.spin.variation;
    if (of_current) found.spin = late;
  }
  found.lag_is_of_current = of_current;
  for (const PositionLog* log : found.in_motion) {
    hooks.checkpoint();
    if (const SpeedLag lag = fit_speed_lag(*log); lag.lag() > found.speed_lag.lag())
      found.speed_lag = lag;
  }
}

// The winding's voltage over the judging rows, or over the others.
WindingVoltage voltage_of(const std::vector<PositionLog>& logs, const MachineParameters& machine,
                          bool judging) {
  constexpr std::size_t kFewest = 200;  // rows, as for any log
  std::vector<PositionLog> resting, moving;
  for (const PositionLog& log : logs) {
    PositionLog part{.path = log.path};
    for (std::size_t k = 0; k < log.size(); ++k) {
      const bool judges = log.held_out || (!log.judges.empty() && log.judges[k]);
      if (judges != judging || log.u_q.empty() || !log.has_time()) continue;
      part.t.push_back(log.t[k]);
      part.theta_m.push_back(log.theta_m[k]);
      part.i_q.push_back(log.i_q[k]);
      part.u_q.push_back(log.u_q[k]);
    }
    if (part.size() < kFewest) continue;
    (is_quasi_static(log, machine) ? resting : moving).push_back(std::move(part));
  }
  std::vector<const PositionLog*> at_rest, in_motion;
  for (const PositionLog& log : resting) at_rest.push_back(&log);
  for (const PositionLog& log : moving) in_motion.push_back(&log);
  return trace_winding_voltage(at_rest, in_motion, machine);
}

// Throws TraceStopped if nothing was found yet; else keeps the findings so far.
void find(const std::vector<PositionLog>& logs, const MachineParameters& machine,
          const TraceHooks& hooks, Found& found) {
  found.holding = trace_holding_torque(found.at_rest, machine, hooks);
  hooks.tell(fmt::format("holding torque: {} orders of cogging", found.holding.cogging.size()));
  try {
    hooks.checkpoint();
    find_in_motion(machine, hooks, found);
    hooks.tell("motion: done");
    hooks.checkpoint();
    found.voltage = trace_winding_voltage(found.at_rest, found.in_motion, machine);
    found.voltage_fitted = voltage_of(logs, machine, false);
    found.voltage_unseen = voltage_of(logs, machine, true);
    hooks.tell("voltage: done");
  } catch (const TraceStopped&) {
  }
}

TraceResult trace_considered(const std::vector<PositionLog>& logs, const DriveFacts& facts,
                             const PositionSettings& settings) {
  TraceResult r;
  Found found{.machine = facts.machine};
  for (const PositionLog& log : logs) {
    const bool at_rest = is_quasi_static(log, facts.machine);
    (log.held_out ? r.held_out_sources : r.sources).push_back(log.path);
    if (!log.judges.empty()) r.held_out_sources.push_back(log.path);
    r.health.push_back(fmt::format(
        "{}: {} rows, {}{}", log.path, log.size(),
        at_rest ? "the current holds the rotor" : "the current accelerates the rotor",
        log.has_time() ? fmt::format(", every {:.3g} ms (median)", 1e3 * sample_interval(log))
                       : std::string(", no time")));
    if (!log.held_out) (at_rest ? found.at_rest : found.in_motion).push_back(&log);
  }
  const TraceHooks& hooks = settings.hooks;
  find(logs, facts.machine, hooks, found);
  drop_excluded(settings.considered, found);
  Judge judge(logs, facts.machine, settings.horizon, hooks);
  if (!found.holding.cogging.empty()) judge.find_other_zeros(found);
  for (const PositionLog* log : judge.other_zero())
    r.health.push_back(log->path +
                       ": its angle has another zero than the logs that show the cogging; judged "
                       "without it");
  if (!hooks.stopped()) {
    refuse_orders(found, judge, hooks, r);
    refuse_claims(found, judge, r);
    refuse_whole(found, judge, r);
  }
  add_periodic(found, judge, facts, r);
  add_friction(found, judge, facts, r);
  add_inertia(found, judge, facts, r);
  add_lags(found, judge, facts, r);
  add_voltage(found, facts, settings.considered, r);
  leave_out_excluded(settings.considered, r);
  add_errors(found, judge, r);
  r.interrupted = hooks.stopped();
  if (!r.interrupted) r.pictures = position_pictures(found, judge);
  if (r.interrupted) {
    if (r.effects.empty()) throw TraceStopped{};
    r.verdict = "unexplained";  // only a part of the judging rows was read
    r.sentence =
        "Interrupted: more effects may be missing, and those found are tested only in part. So "
        "far: " +
        sentence(r, found, judge);
    return r;
  }
  if (found.at_rest.empty())
    r.not_identifiable.push_back({"cogging",
                                  "no log in which the current holds the rotor; a slow sweep of "
                                  "the position would show it"});
  if (found.in_motion.empty())
    r.not_identifiable.push_back({"inertia", "no log in which the current accelerates the rotor"});
  const double turns = turns_covered(found.at_rest);
  if (!found.at_rest.empty() && turns < 0.9)
    r.not_identifiable.push_back(
        {"cogging",
         fmt::format("the sweep covers {:.2f} of a turn; a whole turn is needed", turns)});
  for (const std::string& kind : effect_kinds()) {
    const auto needed = make_effect(kind)->tracing().signals_needed();
    const bool of_voltage = std::any_of(needed.begin(), needed.end(), [](const std::string& name) {
      return name.starts_with("u_") || name.starts_with("v_dc");
    });
    if (of_voltage && kind != "resistance")
      r.not_identifiable.push_back({kind, "phase currents and both voltages are not in the data"});
  }
  leave_out_excluded(settings.considered, r);
  r.verdict = verdict_of(r);
  r.sentence = (r.effects.empty() ? "" : headline_begins(r)) + sentence(r, found, judge);
  if (r.effects.empty())
    if (const std::string why = nothing_explained(r, judge); !why.empty()) {
      r.verdict = "ambiguous";
      r.sentence = why;
    }
  // A claim that transfers and fails as a whole points to a cause. A claim that does not transfer
  // may be chance, which does not show that nothing is missing.
  const bool nothing = r.effects.empty();
  const auto held_back = std::find_if(r.refused.begin(), r.refused.end(), [&](const Refused& x) {
    return x.rule == "whole" || (nothing && x.leaves_doubt());
  });
  if (r.effects.empty() && held_back != r.refused.end()) {
    r.verdict = held_back->rule == "whole" ? "unexplained" : "ambiguous";
    r.sentence = refused_in_words(*held_back);
  }
  if (r.effects.empty() && !found.at_rest.empty() && turns < 0.9) {
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell: the sweep covers {:.2f} of a turn; a whole turn is needed.", turns);
  }
  return r;
}

}  // namespace

TraceResult trace_positions(const std::vector<PositionLog>& logs, const DriveFacts& facts,
                            const PositionSettings& settings) {
  for (const PositionLog& log : logs) {
    std::vector<double> sizes;
    for (const double i_q : log.i_q) sizes.push_back(std::abs(i_q));
    std::optional<Inconsistency> far = far_current(std::move(sizes), facts);
    if (!far) continue;
    if (logs.size() > 1) far->file = log.path;
    TraceResult r = inconsistent_result({*far}, {});
    for (const PositionLog& read : logs)
      (read.held_out ? r.held_out_sources : r.sources).push_back(read.path);
    return r;
  }
  TraceResult r = trace_considered(logs, facts, settings);
  tell_excluded(settings.considered, r);
  return r;
}

namespace {

// One of every `every` means judges, at a position that shifts from group to group, so that a part
// periodic in the angle is judged at all its phases. Each mean is short against a period of any
// order. Otherwise an order could fit into the gaps that the judging rows leave, where the other
// rows do not determine it.
std::vector<char> judging_rows(const PositionLog& log, std::size_t every) {
  const std::size_t length = judged_length(log);
  std::vector<char> judges(log.size(), 0);
  for (std::size_t k = 0; k < log.size(); ++k) {
    const std::size_t piece = k / length, group = piece / every;
    judges[k] = piece % every == group * (group + 1) / 2 % every;
  }
  return judges;
}

void hold_out_late(const PositionLog& log, double share, std::vector<PositionLog>& all) {
  PositionLog train{.path = log.path}, unseen{.path = log.path, .held_out = true};
  for (std::size_t k = 0; k < log.size(); ++k) {
    const bool late = static_cast<double>(k) >= (1 - share) * static_cast<double>(log.size());
    PositionLog& to = late ? unseen : train;
    to.t.push_back(log.t[k]);
    to.theta_m.push_back(log.theta_m[k]);
    to.i_q.push_back(log.i_q[k]);
    if (!log.omega_m.empty()) to.omega_m.push_back(log.omega_m[k]);
    if (!log.u_q.empty()) to.u_q.push_back(log.u_q[k]);
  }
  all.push_back(std::move(train));
  all.push_back(std::move(unseen));
}

}  // namespace

std::vector<PositionLog> hold_out(const std::vector<PositionLog>& logs, double share,
                                  const MachineParameters& machine) {
  std::vector<PositionLog> all;
  for (const PositionLog& log : logs) {
    if (!is_quasi_static(log, machine)) {
      hold_out_late(log, share, all);
      continue;
    }
    all.push_back(log);
    all.back().judges = judging_rows(log, static_cast<std::size_t>(std::lround(1 / share)));
  }
  return all;
}

}  // namespace twinrate
