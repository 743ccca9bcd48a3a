#include "trace/measured_result.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/static_picture.hpp"

namespace twinrate {
namespace {

std::string percent(double part) {
  return fmt::format("{:.1f} %", 100 * part);
}

constexpr double kNotJudged = std::numeric_limits<double>::quiet_NaN();

// What the model would lose without the effect.
struct Worth {
  double held_out_gain = kNotJudged, delta_bic = kNotJudged;
};

Worth worth(const StaticTrace& trace, std::size_t term) {
  const StaticProblem& p = trace.problem;
  const StaticFit& with = trace.selection.after;
  std::vector<StaticTerm> others = with.terms;
  const auto keys = others[term].linear.size() + others[term].searched.size();
  others.erase(others.begin() + static_cast<std::ptrdiff_t>(term));
  const StaticFit without = fit_static(p, others);
  const double N = static_cast<double>(p.y.cols()) *
                   static_cast<double>(std::count(p.held_out.begin(), p.held_out.end(), 0));
  return {1 - with.held_out_cost / std::max(without.held_out_cost, 1e-300),
          N * std::log(with.cost / without.cost) + static_cast<double>(keys) * std::log(N)};
}

TracedEffect traced_effect(const StaticTrace& trace, std::size_t i, bool& interrupted) {
  const StaticFit& after = trace.selection.after;
  TracedEffect e;
  e.effect = after.terms[i].effect;
  e.equation = "electrical";
  e.parameters = traced_parameters(*e.effect, after.sigma[i]);
  Worth own;
  try {
    own = worth(trace, i);
  } catch (const TraceStopped&) {
    interrupted = true;
  }
  e.held_out_gain = own.held_out_gain;
  e.delta_bic = own.delta_bic;
  // Of the fall of the training cost, as a likelihood ratio.
  e.p_value =
      std::isfinite(own.delta_bic) ? std::exp(std::min(0.0, 0.5 * own.delta_bic)) : kNotJudged;
  e.materiality = e.effect->tracing().materiality(trace.problem.facts);
  return e;
}

EquationError channel_error(const StaticTrace& trace, Eigen::Index channel, const char* unit) {
  const StaticFit &before = trace.selection.before, &after = trace.selection.after;
  const StaticProblem& p = trace.problem;
  EquationError e{.unit = unit,
                  .before = {before.train[channel], before.held_out[channel]},
                  .after = {after.train[channel], after.held_out[channel]}};
  e.no_change = std::numeric_limits<double>::quiet_NaN();  // nothing changes with time here
  e.noise_floor = std::numeric_limits<double>::quiet_NaN();
  e.whiteness_p_value = std::numeric_limits<double>::quiet_NaN();
  e.rows = static_cast<std::size_t>(p.y.rows());
  return e;
}

void add_inverter_alias(const StaticTrace& trace, TraceResult& r) {
  const std::vector<StaticTerm>& terms = trace.selection.after.terms;
  const auto drop = std::find_if(terms.begin(), terms.end(), [](const StaticTerm& term) {
    return reading_of(*term.effect, Traits::Reading::kItsThreshold);
  });
  if (drop == terms.end()) return;
  const std::string kind(drop->effect->kind()),
      threshold = reading_of(*drop->effect, Traits::Reading::kItsThreshold)->kind,
      slope = reading_of(*drop->effect, Traits::Reading::kItsSlope)->kind;
  const auto dead_time = equivalent_dead_time(*drop->effect, trace.problem.facts);
  for (TracedEffect& e : r.effects)
    if (e.effect->kind() == kind) e.aliases = {threshold};
  std::string same = "a dead time of that shape is the same curve at one bus voltage";
  if (dead_time)
    same = fmt::format("a dead time of {:.2f} us at {} V and {} Hz is the same curve",
                       1e6 * get_key(*dead_time, "dead_time_s"), trace.problem.facts.v_dc,
                       trace.problem.facts.f_pwm);
  r.ambiguous.push_back(
      {{kind, threshold},
       same,
       "the same curve at another bus voltage: the loss of a dead time grows with "
       "it, that of a device does not"});
  r.ambiguous.push_back(
      {{slope, kind},
       "the slope of the switches' forward voltage is part of the resistance found",
       "the resistance of the winding measured without the inverter"});
}

}  // namespace

TraceResult static_result(const StaticSet& set, const StaticTrace& trace, StaticKind kind) {
  TraceResult r;
  r.sources = {set.path};
  const StaticSelection& s = trace.selection;
  const bool found = !s.steps.empty();
  r.interrupted = s.interrupted;
  r.health.push_back(fmt::format("{} points; held out: {}", set.size(), trace.held_out_rule));
  // Constants are effects where they are off by more than matters; where a law stands on them, also
  // by less, but not by next to nothing.
  const double least = found ? 0.1 : 1;
  for (std::size_t i = 0; i < s.after.terms.size(); ++i) {
    TracedEffect e = traced_effect(trace, i, r.interrupted);
    const bool constant = s.before.find(e.effect->kind()) != nullptr;
    if (!constant || e.materiality > least) r.effects.push_back(std::move(e));
  }
  const bool map = kind == StaticKind::kFluxMap;
  const Eigen::Index channel = map ? 1 : 0;
  r.electrical = channel_error(trace, channel, map ? "Wb" : "V");
  r.main_equation = "electrical";
  for (Eigen::Index c = 0; c < s.before.held_out.size(); ++c)
    r.identifiable.push_back(
        fmt::format("held-out error of {}: {:.4g} before (constants fitted), {:.4g} after: {:.1f} "
                    "times smaller",
                    trace.problem.channels[static_cast<std::size_t>(c)], s.before.held_out[c],
                    s.after.held_out[c], s.before.held_out[c] / s.after.held_out[c]));
  r.pictures = static_pictures(trace, kind);
  add_inverter_alias(trace, r);
  r.verdict = found ? "traced" : r.effects.empty() ? "nothing_missing" : "traced";
  std::vector<std::string> kinds;
  for (const TracedEffect& e : r.effects) kinds.emplace_back(e.effect->kind());
  r.sentence =
      kinds.empty()
          ? fmt::format("No effect is missing: with constants the held-out error is {:.3g} {}",
                        r.electrical->after.held_out, r.electrical->unit)
          : fmt::format(
                "The model lacks {}. With {} added, the held-out error of {} falls from {:.3g} to "
                "{:.3g} {} ({} of the error before)",
                fmt::join(kinds, ", "), kinds.size() == 1 ? "it" : "these",
                trace.problem.channels[static_cast<std::size_t>(channel)],
                r.electrical->before.held_out, r.electrical->after.held_out, r.electrical->unit,
                percent(r.electrical->after.held_out / r.electrical->before.held_out));
  if (r.interrupted)
    r.sentence = fmt::format(
        "Interrupted after {} step{} of the selection: more effects may be missing. So far: {}",
        s.steps.size(), s.steps.size() == 1 ? "" : "s", r.sentence);
  return r;
}

}  // namespace twinrate
