#include "trace/conclude.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <set>

#include "model/effects/catalogue.hpp"
#include "model/effects/losses.hpp"
#include "trace/correction.hpp"
#include "trace/doubts.hpp"
#include "trace/effect_view.hpp"
#include "trace/errors.hpp"
#include "trace/evidence.hpp"
#include "trace/fall.hpp"
#include "trace/gate.hpp"
#include "trace/keys.hpp"
#include "trace/residual_structure.hpp"
#include "trace/sampler.hpp"
#include "trace/split_equivalents.hpp"
#include "trace/verdict.hpp"

namespace twinrate {
namespace {

constexpr double kFewRows = 5e-4;  // of all rows: a smaller share is not reported
constexpr double kBlind = 4;       // sigmas that a smallest effect needs to be visible

using Fault = Traits::FromFault;

// Size of the fault, as a key of the effect has it; 0: absent.
double size_of(Fault::Fault fault, const DriveFacts& facts, const Health& health) {
  const auto more_than_few = [](double share) { return share > kFewRows ? share : 0; };
  switch (fault) {
    case Fault::kCoarseCurrents:
      return health.coarse(facts.machine.i_rated) ? health.i_lsb : 0;
    case Fault::kLimitedCurrents:
      return std::max(0.0, health.i_limit);
    case Fault::kMissingRows:
      return more_than_few(health.missing_share);
    case Fault::kStaleRows:
      return more_than_few(health.stale_share);
    case Fault::kHeldCurrents:
      return more_than_few(health.held_share);
  }
  return 0;
}

// An excluded kind as a line about the data.
std::string shown_by_samples(const Effect& effect) {
  std::vector<std::string> sizes;
  for (const TracedParameter& p : traced_parameters(effect, {}))
    sizes.push_back(p.text.empty() ? fmt::format("{} {:.3g}{}", p.name, p.value,
                                                 p.unit == "1" ? "" : " " + p.unit)
                                   : fmt::format("{} {}", p.name, p.text));
  return fmt::format("the samples show {}: {} ({}, excluded by --exclude)", effect.meaning(),
                     fmt::join(sizes, ", "), effect.kind());
}

void from_samples(const DriveFacts& facts, const Health& health, const Considered& considered,
                  TraceResult& r) {
  r.health = health.lines();
  // The values of a coarse converter also repeat by chance, more often than the counts of
  // held_currents.hpp assume: of 81 drawn logs with such a converter, three named repeated rows
  // that the drive did not have.
  std::string coarse;  // kind of the coarse converter, if there is one
  const auto add = [&](const std::shared_ptr<const Effect>& effect, Fault::Fault fault) {
    if (!considered(effect->kind())) return r.health.push_back(shown_by_samples(*effect));
    TracedEffect e{.effect = effect, .equation = "sensing"};
    e.parameters = traced_parameters(*effect, {});
    e.materiality = e.effect->tracing().materiality(facts);
    e.from_samples = true;
    if (fault == Fault::kCoarseCurrents) coarse = effect->kind();
    const bool repeated = fault == Fault::kStaleRows || fault == Fault::kHeldCurrents;
    if (repeated && !coarse.empty()) e.aliases = {coarse};
    r.effects.push_back(std::move(e));
  };
  for (const std::string& kind : kinds_of(Traits::Family::kSamples)) {
    const Stated<Fault> faults = make_effect(kind)->tracing().traits().faults;
    for (const Fault& of : faults) {
      const double size = size_of(of.fault, facts, health);
      if (size == 0) continue;
      const auto effect = make_effect(kind);
      set_key(*effect, of.size_key, size);
      if (*of.choice_key) set_key(*effect, of.choice_key, of.position);
      add(effect, of.fault);
    }
  }
}

void from_bus(const BusRipple& bus, TraceResult& r) {
  r.effects.insert(r.effects.end(), bus.effects.begin(), bus.effects.end());
  r.refused.insert(r.refused.end(), bus.refused.begin(), bus.refused.end());
  r.bus = bus.error;
  r.pictures = bus.pictures;
  r.health.insert(r.health.end(), bus.notes.begin(), bus.notes.end());
}

// Kinds that the record can and cannot show, by the smallest size worth reporting over its sigma.
void identifiability(const Fitter& fitter, const Dictionary& dictionary, const Fit& fit,
                     TraceResult& r) {
  std::map<std::string, double> best;  // by kind: sigma over smallest size
  std::map<std::string, double>
      estimate;  // size over the smallest, of a kind whose estimate was not confirmed
  const std::vector<Score> scores = score_all(fitter, fit, dictionary.whitened);
  const DriveFacts& facts = fitter.chain().equations().facts();
  const double moved = fitter.chain().equations().record().angle.moved;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const std::string kind(dictionary.whitened[i].effect->kind());
    const double sigma =
        scores[i].effect && scores[i].sigma_in_sizes > 0 ? scores[i].sigma_in_sizes : 1e9;
    const auto [place, first] = best.emplace(kind, sigma);
    if (!first) place->second = std::min(place->second, sigma);
    const double sizes = scores[i].effect ? scores[i].effect->tracing().materiality(facts) : 0;
    if (sizes > 1 + kBlind * sigma) estimate[kind] = std::max(estimate[kind], sizes);
  }
  for (const TracedEffect& e : r.effects) {
    best.erase(std::string(e.effect->kind()));
    for (const std::string& alias : e.aliases) best.erase(alias);  // may be the present effect
  }
  // A kind that was found and refused as sensor noise is not shown to be absent.
  const auto refused_as_noise = [&](const std::string& kind) {
    return std::find_if(r.refused.begin(), r.refused.end(),
                        [&](const Refused& x) { return x.kind == kind && x.rule == "sensors"; });
  };
  for (const auto& [kind, sigma] : best) {
    if (make_effect(kind)->tracing().regressor_count() == 0) continue;
    if (moved != 0 && kind == make_of(Traits::Family::kAngleSensor)->kind()) {
      r.not_identifiable.emplace_back(
          kind, fmt::format("theta_m was moved by {:.2g} rad: rounding looks the same", moved));
    } else if (const auto noise = refused_as_noise(kind); noise != r.refused.end()) {
      r.not_identifiable.emplace_back(kind, noise->text);
    } else if (estimate.count(kind)) {
      r.not_identifiable.emplace_back(
          kind,
          fmt::format(
              "its estimate of {:.2g} times the smallest size worth reporting was not confirmed",
              estimate[kind]));
    } else if (kBlind * sigma < 1) {
      r.identifiable.push_back(kind);
    } else {
      r.not_identifiable.emplace_back(
          kind,
          sigma > 1e8
              ? "this record does not excite it"
              : fmt::format(
                    "one standard deviation is {:.2g} times the smallest size worth reporting",
                    sigma));
    }
  }
}

// True if the bus voltage hardly changes. The loss of a dead time is in proportion to the bus
// voltage and a device's drop is not, so at one bus voltage they are aliases, whichever fits better
// beside the other effects.
bool one_bus_voltage(const Record& record) {
  constexpr double kConstantVoltage = 0.02;
  if (record.v_dc.empty()) return true;
  const Eigen::Map<const Eigen::ArrayXd> v(record.v_dc.data(),
                                           static_cast<Eigen::Index>(record.v_dc.size()));
  return (v - v.mean()).square().mean() < kConstantVoltage * kConstantVoltage * v.mean() * v.mean();
}

// A constant, positive change may be the slope of a device's drop, which has a threshold and a
// slope.
bool may_be_slope(const Effect& effect, const Traits::Reading& slope) {
  if (effect.kind() != slope.kind) return false;
  const std::string key = slope.keys.begin()->to;
  const auto same = make_effect(std::string(effect.kind()));
  set_key(*same, key, get_key(effect, key));
  return get_key(effect, key) > 0 && key_values(*same) == key_values(effect);
}

// Kinds that a record without voltage shows only through the ratio K_t/J.
std::vector<std::string> kinds_of_ratio() {
  const auto inertia = make_of(Traits::Family::kInertia);
  std::vector<std::string> kinds = kinds_read(*inertia, Traits::Reading::kWithoutVoltage);
  kinds.insert(kinds.begin(), std::string(inertia->kind()));
  return kinds;
}

// True if the acceleration of this record is mostly noise of the angle, so that no inertia was
// tried.
bool no_inertia_tried(const Dictionary& dictionary) {
  const auto shows = [](const Sampled& x) { return x.torque.size() && x.torque.squaredNorm() > 0; };
  return std::none_of(dictionary.whitened.begin(), dictionary.whitened.end(),
                      [&](const Candidate& c) {
                        return is_of(*c.effect, Traits::Family::kInertia) &&
                               std::any_of(c.columns.begin(), c.columns.end(), shows);
                      });
}

void name_aliases(const Record& record, const Considered& considered, const Dictionary& dictionary,
                  TraceResult& r) {
  constexpr std::size_t kMostAliases = 2;
  const std::vector<std::string> ratio =
      record.has_voltage_equation() ? std::vector<std::string>() : kinds_of_ratio();
  for (TracedEffect& e : r.effects) {
    if (std::count(ratio.begin(), ratio.end(), e.effect->kind()))
      for (const std::string& kind : ratio)
        if (kind != e.effect->kind() && !std::count(e.aliases.begin(), e.aliases.end(), kind))
          e.aliases.push_back(kind);
    const auto lacks = [&](const Traits::Reading* reading) {
      return std::count(e.aliases.begin(), e.aliases.end(), reading->kind) == 0;
    };
    const auto* drop = reading_of(*e.effect, Traits::Reading::kAtOneBusVoltage);
    const auto* threshold = reading_of(*e.effect, Traits::Reading::kItsThreshold);
    for (const Traits::Reading* loss : {drop, threshold})
      if (loss && e.aliases.size() < kMostAliases && lacks(loss) && one_bus_voltage(record))
        e.aliases.emplace_back(loss->kind);
    // A resistance beside such a loss may be part of one drop, which has both.
    for (const TracedEffect& loss : r.effects) {
      const auto* device = reading_of(*loss.effect, Traits::Reading::kAtOneBusVoltage);
      if (!device || !one_bus_voltage(record) || !lacks(device)) continue;
      const auto whole = make_effect(device->kind);
      const auto* slope = reading_of(*whole, Traits::Reading::kItsSlope);
      if (slope && may_be_slope(*e.effect, *slope)) e.aliases.emplace_back(device->kind);
    }
    // A shaft may be an inertia, the one that the shaft takes off the motor.
    const std::string inertia(make_of(Traits::Family::kInertia)->kind());
    if (is_shaft(*e.effect) && no_inertia_tried(dictionary) &&
        !std::count(e.aliases.begin(), e.aliases.end(), inertia))
      e.aliases.push_back(inertia);
    // If a torsion leaves bursts, it may be a gap, which then explains them.
    const auto* gap = reading_of(*e.effect, Traits::Reading::kWhereBurstsRemain);
    const bool loose =
        gap && considered(gap->kind) &&
        std::erase_if(r.unexplained, [](const Structure& s) { return s.bursts; }) > 0;
    if (loose && lacks(gap)) e.aliases.insert(e.aliases.begin(), gap->kind);
    e.aliases = considered.of(std::move(e.aliases));
    if (e.aliases.empty()) continue;
    Ambiguity a{.kinds = {std::string(e.effect->kind())}};
    a.kinds.insert(a.kinds.end(), e.aliases.begin(), e.aliases.end());
    a.why = loose ? "the residual beside the shaft comes in bursts, like impacts in a gap"
            : e.from_samples ? "the values of a coarse converter also repeat by chance"
                             : "they explain this record equally well";
    a.would_separate = what_separates(a.kinds);
    r.ambiguous.push_back(std::move(a));
  }
}

// A claim does not need a model that beats no change. If the model does not, the sentence says so.
std::string against_no_change(const EquationError& e, double horizon_s) {
  if (e.after.held_out <= e.no_change) return "";
  return fmt::format(
      ". A prediction of no change over {:.3g} ms has an error of {:.3g} {}: this log changes too "
      "little to show how well the model predicts",
      1e3 * horizon_s, e.no_change, e.unit);
}

// The fall of the error on judging rows, in words; empty if none falls.
std::string fall_of(const TraceResult& r, bool one, bool corrected) {
  const bool bus_alone = std::all_of(r.effects.begin(), r.effects.end(),
                                     [](const auto& e) { return e.effect->acts_on() == kOnBus; });
  const bool of_bus = bus_alone && r.bus, of_voltage = r.main_equation == "electrical";
  const auto& main = of_bus ? r.bus : of_voltage ? r.electrical : r.mechanical;
  if (!main) return "";
  const auto falls = fall_in_words(main->before.held_out, main->after.held_out, main->unit);
  if (!falls) return "";
  return fmt::format(". With {}, the held-out {} error {} rms (noise floor {:.3g})",
                     corrected ? "this corrected"
                     : one     ? "it added"
                               : "these added",
                     of_bus       ? "bus voltage"
                     : of_voltage ? "voltage"
                                  : "torque",
                     *falls, main->noise_floor) +
         (of_bus ? "" : against_no_change(*main, r.horizon_s));
}

std::string what_the_model_lacks(const TraceResult& r) {
  std::vector<std::string> lacking, too_much;
  for (const TracedEffect& e : r.effects) {
    std::string name(e.effect->kind());
    if (!e.aliases.empty()) name += fmt::format(" (or {})", fmt::join(e.aliases, ", "));
    (takes_back(*e.effect) ? too_much : lacking).push_back(name);
  }
  std::string text = "The model";
  if (!lacking.empty()) text += fmt::format(" lacks {}", fmt::join(lacking, ", "));
  if (!lacking.empty() && !too_much.empty()) text += " and";
  if (!too_much.empty()) text += fmt::format(" has too much {}", fmt::join(too_much, ", "));
  return text + fall_of(r, lacking.size() == 1, !too_much.empty());
}

std::string sentence(const TraceResult& r) {
  if (r.verdict == "nothing_missing")
    return fmt::format("{} below {:.0f} Hz.", nothing_in_words(r),
                       Sampler::kPassband / r.horizon_s);
  std::string text = headline_begins(r);
  if (!r.effects.empty()) return text + what_the_model_lacks(r) + ".";
  if (r.verdict == "ambiguous") return text + kLongerRun;
  return text.substr(0, text.size() - 1);
}

// Effects and stop-gaps that passed, with the parameters of the last fit. Returns the structures of
// the stop-gaps.
std::vector<Structure> add_members(const Conclusion& c, TraceResult& r) {
  std::vector<Structure> lines;
  const Fit& fit = c.selection.fit;
  for (std::size_t m = 0; m < fit.members.size(); ++m) {
    const Selected& selected = c.selection.members[m];
    TracedEffect e = traced_effect(c.rounds, fit, selected, m, c.lag_is_open);
    take_parameters(c.last, c.fitted, m, e);
    e.held_out_gain = c.passed.judgements[m].held_out_gain;
    if (is_placed(*fit.members[m], Traits::Place::kLine)) {
      lines.push_back(line_structure(*c.fitted.members[m], selected));
      lines.back().doubt = doubt_of_line(*c.fitted.members[m], c.last.chain(), c.health.i_lsb);
      r.stop_gaps.push_back(std::move(e));
      continue;
    }
    for (const Alternative& a : selected.alternatives)
      r.rejected.push_back({a.kind, a.score_gain, a.held_out_gain,
                            fmt::format("in place of {}: {}", e.effect->kind(), a.why)});
    r.effects.push_back(std::move(e));
  }
  for (const Alternative& a : c.selection.refused)
    r.rejected.push_back({a.kind, a.score_gain, a.held_out_gain, a.why});
  r.refused = c.passed.refused;
  return lines;
}

// A gap is only searched after a shaft without a gap was found.
void doubt_gap(const Considered& considered, TraceResult& r) {
  const std::string shaft(make_placed(Traits::Place::kShaft)->kind()),
      gap(make_placed(Traits::Place::kGap)->kind());
  if (considered(shaft) || !considered(gap)) return;
  r.not_identifiable.emplace_back(
      gap, fmt::format("it is looked for beside a {}, which --exclude leaves out", shaft));
}

// The kinds in neither list. For a shaft, a lag and the kinds from the samples, the smallest
// visible size is not computed.
void name_the_others(const Equations& equations, TraceResult& r) {
  std::set<std::string> told(r.identifiable.begin(), r.identifiable.end());
  for (const auto& [kind, why] : r.not_identifiable) told.insert(kind);
  for (const TracedEffect& e : r.effects) {
    told.insert(std::string(e.effect->kind()));
    told.insert(e.aliases.begin(), e.aliases.end());
  }
  const bool torque_only = !equations.has_voltage();
  for (const std::string& kind : equations.considered().kinds()) {
    if (told.count(kind)) continue;
    const std::shared_ptr<Effect> effect = make_effect(kind);
    const bool is_electrical = effect->tracing().traits().equation == Traits::Equation::kElectrical,
               in_no_row = torque_only && is_electrical && !is_of(*effect, Traits::Family::kLag);
    r.not_identifiable.emplace_back(kind, in_no_row ? "no row has a voltage equation"
                                          : equations.needs_missing_i_d(*effect)
                                              ? "it requires i_d, which is not in the log"
                                              : "its smallest visible size is not computed");
  }
}

void split_parts(const DriveFacts& facts, const Considered& considered, TraceResult& r) {
  std::vector<TracedEffect> parts;
  for (TracedEffect& e : r.effects)
    for (TracedEffect& part : split_equivalents(std::move(e), facts, considered))
      parts.push_back(std::move(part));
  r.effects = std::move(parts);
}

}  // namespace

TraceResult conclude(const Conclusion& c) {
  TraceResult r;
  const Chain& chain = c.last.chain();
  const DriveFacts& facts = chain.equations().facts();
  const Considered& considered = chain.equations().considered();
  std::vector<Structure> lines = add_members(c, r);
  from_samples(facts, c.health, considered, r);
  from_bus(c.bus, r);
  compare_errors(chain, c.passed.fit.effects(), r);
  compare_files(chain, c.passed.fit.effects(), c.files, r);
  add_effect_views(chain, c.fitted, r);
  split_parts(facts, considered, r);
  std::string unconfirmed;
  // Beside an effect from the samples or the bus, a structure in doubt is reported as well.
  const auto tell = [&](Structure s) {
    if (s.doubt.empty() || !r.effects.empty())
      r.unexplained.push_back(std::move(s));
    else
      unconfirmed = fmt::format("{}, and {}", s.text, s.doubt);
  };
  for (Structure& s : lines) tell(std::move(s));
  const bool whole = c.selection.stopped_after == 0;  // else later effects are in the residual
  if (whole &&
      !c.health.coarse(facts.machine.i_rated))  // else the residual is the shape of the steps
    for (Structure& s : residual_structure(c.last, c.fitted)) tell(std::move(s));
  name_aliases(chain.equations().record(), considered, c.dictionary, r);
  r.structured = !r.unexplained.empty();
  r.corrections = corrections_of(r);
  if (whole) {
    identifiability(c.seen, c.dictionary, c.passed.fit, r);
    const std::string ripple(make_placed(Traits::Place::kBusLine)->kind());
    if (c.bus.effects.empty() && c.bus.blind.empty()) r.identifiable.push_back(ripple);
    if (c.bus.effects.empty() && !c.bus.blind.empty())
      r.not_identifiable.emplace_back(ripple, c.bus.blind);
    doubt_gap(considered, r);
  }
  leave_out_excluded(considered, r);
  r.verdict = verdict_of(r);
  r.sentence = sentence(r);
  if (!whole) {
    const int rounds = c.selection.stopped_after;
    r.interrupted = true;
    r.verdict = "unexplained";  // no judging rows were read
    r.sentence = fmt::format(
        "Interrupted after {} round{} of the selection: more effects may be missing, and those "
        "found are not compared with their alternatives. So far: {}",
        rounds, rounds == 1 ? "" : "s", r.sentence);
    return r;
  }
  if (r.verdict == "nothing_missing") doubt_nothing(c.last, c.fitted, unconfirmed, r);
  if (r.verdict == "traced" &&
      std::all_of(r.effects.begin(), r.effects.end(), [](const auto& e) { return e.from_samples; }))
    doubt_samples_alone(c.last, c.fitted, r);
  if (r.verdict == "traced") doubt_unconfirmed(c.selection.refused, r);
  // A finding that was refused rules out "nothing missing".
  if (r.verdict == "nothing_missing" && refusal_to_tell(r)) {
    r.verdict = "ambiguous";
    r.sentence = sentence(r);
  }
  name_the_others(chain.equations(), r);
  // A lag of the current turns an i_d of field weakening into a torque that grows with the speed.
  if (chain.equations().record().i_q_alone && !r.effects.empty())
    r.sentence += " This holds if i_d was 0: the log has no i_d.";
  return r;
}

}  // namespace twinrate
