#include "trace/measured_result.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "model/effects/catalogue.hpp"
#include "trace/fall.hpp"
#include "trace/keys.hpp"
#include "trace/static_picture.hpp"
#include "trace/verdict.hpp"

namespace twinrate {
namespace {

constexpr double kNotKnown = std::numeric_limits<double>::quiet_NaN();

Eigen::Index points_of(const StaticProblem& p, PointRole role) {
  return std::count(p.role.begin(), p.role.end(), role);
}

TracedEffect traced_effect(const StaticTrace& trace, std::size_t i) {
  const StaticSelection& s = trace.selection;
  TracedEffect e{.effect = s.after.terms[i].effect, .equation = "electrical"};
  e.parameters = traced_parameters(*e.effect, s.after.sigma[i]);
  const Judgement& judged = s.judgements[i];
  e.held_out_gain = judged.held_out_gain;
  const StaticTerm& term = s.after.terms[i];
  const double N =
      static_cast<double>(trace.problem.y.cols() * (points_of(trace.problem, PointRole::kFits) +
                                                    points_of(trace.problem, PointRole::kChooses)));
  const auto keys = static_cast<double>(term.linear.size() + term.searched.size());
  e.delta_bic = N * std::log(1 - judged.fitted_gain) + keys * std::log(N);
  e.p_value = judged.p_value;
  e.materiality = e.effect->tracing().materiality(trace.problem.facts);
  return e;
}

EquationError channel_error(const StaticTrace& trace, Eigen::Index channel, const char* unit) {
  const StaticFit &before = trace.selection.before, &after = trace.selection.after;
  EquationError e{.unit = unit,
                  .before = {before.train[channel], before.held_out[channel]},
                  .after = {after.train[channel], after.held_out[channel]}};
  // A set without time has no change with time.
  e.no_change = e.noise_floor = e.whiteness_p_value = kNotKnown;
  e.rows = static_cast<std::size_t>(trace.problem.y.rows());
  return e;
}

// The channel whose error falls furthest.
Eigen::Index main_channel(const StaticSelection& s) {
  Eigen::Index main = 0;
  (s.before.held_out.array() / s.after.held_out.array().max(1e-300)).maxCoeff(&main);
  return main;
}

// Half the mean square of the difference of neighbours, which is almost entirely noise.
double noise_of(const StaticProblem& p, const Eigen::MatrixXd& rest, Eigen::Index channel,
                int file) {
  double sum = 0, pairs = 0;
  for (std::size_t k = 0; k + 1 < p.order.size(); ++k) {
    if (p.ends_line[k] || p.file[p.order[k]] != file) continue;
    const double step = rest(static_cast<Eigen::Index>(p.order[k + 1]), channel) -
                        rest(static_cast<Eigen::Index>(p.order[k]), channel);
    sum += 0.5 * step * step, ++pairs;
  }
  return pairs > 0 ? std::sqrt(sum / pairs) : kNotKnown;
}

// One line a file and channel: over its judging points, or over all if none judges.
void add_files(const StaticTrace& trace, const char* unit, TraceResult& r) {
  const StaticProblem& p = trace.problem;
  for (std::size_t f = 0; f < p.files.size(); ++f)
    for (Eigen::Index c = 0; c < p.y.cols(); ++c) {
      double rows = 0, all = 0, before[2] = {}, after[2] = {}, judging = 0;
      for (std::size_t k = 0; k < p.role.size(); ++k) {
        if (p.file[k] != static_cast<int>(f)) continue;
        const bool judges = p.role[k] == PointRole::kJudges;
        const auto row = static_cast<Eigen::Index>(k);
        ++all, judging += judges;
        before[judges] += std::pow(trace.selection.before.rest(row, c), 2);
        after[judges] += std::pow(trace.selection.after.rest(row, c), 2);
      }
      const bool judged = judging > 0;
      rows = judged ? judging : all;
      r.files.push_back({.path = p.files[f],
                         .held_out = judging == all,
                         .unit = unit,
                         .rows = static_cast<std::size_t>(all),
                         .no_change = kNotKnown,
                         .before = std::sqrt(before[judged] / rows),
                         .after = std::sqrt(after[judged] / rows),
                         .noise = noise_of(p, trace.selection.after.rest, c, static_cast<int>(f)),
                         .signals = {p.channels[static_cast<std::size_t>(c)]}});
    }
}

// The constants that these points would show at the smallest size worth reporting.
void identifiability(const StaticTrace& trace, TraceResult& r) {
  constexpr double kBlind = 4;  // standard deviations that a smallest effect needs to be visible
  const StaticFit& fit = trace.selection.constants;
  for (std::size_t i = 0; i < fit.terms.size(); ++i) {
    const auto effect = fit.terms[i].effect->clone();
    for (const auto& [key, sigma] : fit.sigma[i]) set_key(*effect, key, sigma);
    const std::string kind(effect->kind());
    const double size = effect->tracing().materiality(trace.problem.facts);
    const bool named = trace.selection.after.find(kind) != nullptr;
    if (kBlind * size < 1 && !named)
      r.identifiable.push_back(kind);
    else if (!named)
      r.not_identifiable.emplace_back(
          kind,
          fmt::format("one standard deviation is {:.2g} times the smallest size worth reporting",
                      size));
  }
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

// An inverter curve shows a dead time through the drop with the same curve.
void blind_to_threshold(const StaticTrace& trace, StaticKind kind, TraceResult& r) {
  if (kind != StaticKind::kInverterCurve) return;
  for (const std::string& whole : trace.considered.excluded())
    if (const auto* part = reading_of(*make_effect(whole), Traits::Reading::kItsThreshold))
      r.not_identifiable.emplace_back(
          part->kind, fmt::format("it is looked for as an {}, which --exclude leaves out", whole));
}

// The part of a channel that no effect explains.
void add_rest(const StaticTrace& trace, const char* unit, TraceResult& r) {
  for (const StaticRest& left : trace.selection.left)
    r.unexplained.push_back({.regressor = trace.problem.channels.size() > 1 ? "i_d, i_q" : "i_q",
                             .share = left.share,
                             .equation = "electrical",
                             .text = fmt::format("{:.3g} {} of {} that depend on the current",
                                                 left.size, unit, left.channel)});
  r.structured = !r.unexplained.empty();
}

std::string sentence_of(const StaticTrace& trace, const TraceResult& r) {
  const StaticSelection& s = trace.selection;
  const Eigen::Index main = main_channel(s);
  const std::string& channel = trace.problem.channels[static_cast<std::size_t>(main)];
  if (r.verdict == "nothing_missing")
    return fmt::format("{}. The held-out error of {} is {:.3g} {}.", nothing_in_words(r), channel,
                       s.after.held_out[main], r.electrical->unit);
  std::string text = headline_begins(r);
  if (r.effects.empty()) return text.substr(0, text.size() - 1);
  std::vector<std::string> kinds;
  for (const TracedEffect& e : r.effects)
    kinds.push_back(e.aliases.empty()
                        ? std::string(e.effect->kind())
                        : fmt::format("{} (or {})", e.effect->kind(), fmt::join(e.aliases, ", ")));
  text += fmt::format("The model lacks {}", fmt::join(kinds, ", "));
  if (const auto falls =
          fall_in_words(s.before.held_out[main], s.after.held_out[main], r.electrical->unit))
    text += fmt::format(". With {} added, the held-out error of {} {} (constants alone: {:.3g})",
                        kinds.size() == 1 ? "it" : "these", channel, *falls,
                        s.constants.held_out[main]);
  return text + ".";
}

// If nothing was found, these points may still hide effects in their noise.
void doubt_nothing(TraceResult& r) {
  if (r.verdict != "nothing_missing" || r.not_identifiable.empty()) return;
  std::vector<std::string> blind;
  for (const auto& [kind, why] : r.not_identifiable) blind.push_back(kind);
  r.verdict = "ambiguous";
  r.sentence =
      fmt::format("Cannot tell: the noise of these points hides {}. Average more readings a point.",
                  fmt::join(blind, ", "));
}

}  // namespace

TraceResult static_result(const StaticSet& set, const StaticTrace& trace, StaticKind kind) {
  TraceResult r;
  r.sources = {set.path};
  const StaticSelection& s = trace.selection;
  r.interrupted = s.interrupted;
  r.health.push_back(fmt::format("{} points; held out: {}", set.size(), trace.held_out_rule));
  for (std::size_t i = 0; i < s.after.terms.size(); ++i)
    r.effects.push_back(traced_effect(trace, i));
  r.refused = s.refused;
  const char* unit = kind == StaticKind::kFluxMap ? "Wb" : "V";
  r.electrical = channel_error(trace, main_channel(s), unit);
  r.main_equation = "electrical";
  add_files(trace, unit, r);
  identifiability(trace, r);
  for (Eigen::Index c = 0; c < s.before.held_out.size(); ++c)
    if (s.after.held_out[c] < s.constants.held_out[c])
      r.identifiable.push_back(fmt::format(
          "held-out error of {}: {:.4g} before (constants fitted), {:.4g} after: {:.1f} times "
          "smaller",
          trace.problem.channels[static_cast<std::size_t>(c)], s.constants.held_out[c],
          s.after.held_out[c], s.constants.held_out[c] / s.after.held_out[c]));
  r.pictures = static_pictures(trace, kind);
  add_inverter_alias(trace, r);
  add_rest(trace, unit, r);
  blind_to_threshold(trace, kind, r);
  leave_out_excluded(trace.considered, r);
  r.verdict = verdict_of(r);
  if (r.verdict == std::string("nothing_missing") && refusal_to_tell(r)) r.verdict = "ambiguous";
  r.sentence = sentence_of(trace, r);
  doubt_nothing(r);
  if (r.interrupted)
    r.sentence = fmt::format(
        "Interrupted after {} step{} of the selection: more effects may be missing. So far: {}",
        s.steps.size(), s.steps.size() == 1 ? "" : "s", r.sentence);
  tell_excluded(trace.considered, r);
  return r;
}

}  // namespace twinrate
