#include "trace/conclude.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>

#include "model/effects/catalogue.hpp"
#include "model/effects/losses.hpp"
#include "trace/correction.hpp"
#include "trace/effect_view.hpp"
#include "trace/errors.hpp"
#include "trace/evidence.hpp"
#include "trace/keys.hpp"
#include "trace/residual_structure.hpp"
#include "trace/split_equivalents.hpp"

namespace twinrate {
namespace {

constexpr double kFewRows = 5e-4;  // of all rows, not worth a word
constexpr double kBlind = 4;       // sigmas a smallest effect must have to be seen

using Fault = Traits::FromFault;

// Its size, as a key of the effect has it; 0: not there.
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

void from_samples(const DriveFacts& facts, const Health& health, TraceResult& r) {
  const auto add = [&](const std::shared_ptr<const Effect>& effect) {
    TracedEffect e{.effect = effect, .equation = "sensing"};
    e.parameters = traced_parameters(*effect, {});
    e.materiality = e.effect->tracing().materiality(facts);
    e.from_samples = true;
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
      add(effect);
    }
  }
  r.health = health.lines();
}

void from_bus(const BusRipple& bus, TraceResult& r) {
  r.effects.insert(r.effects.end(), bus.effects.begin(), bus.effects.end());
  r.bus = bus.error;
  r.pictures = bus.pictures;
  r.health.insert(r.health.end(), bus.notes.begin(), bus.notes.end());
}

// What one record can and cannot tell: the smallest effect worth reporting against its sigma.
void identifiability(const Fitter& fitter, const Dictionary& dictionary, const Fit& fit,
                     TraceResult& r) {
  std::map<std::string, double> best;  // by kind: sigma over smallest size
  const std::vector<Score> scores = score_all(fitter, fit, dictionary.whitened);
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const std::string kind(dictionary.whitened[i].effect->kind());
    const double sigma =
        scores[i].effect && scores[i].sigma_in_sizes > 0 ? scores[i].sigma_in_sizes : 1e9;
    const auto [place, first] = best.emplace(kind, sigma);
    if (!first) place->second = std::min(place->second, sigma);
  }
  for (const TracedEffect& e : r.effects) {
    best.erase(std::string(e.effect->kind()));
    for (const std::string& alias : e.aliases) best.erase(alias);  // it may be what is there
  }
  for (const auto& [kind, sigma] : best) {
    if (make_effect(kind)->tracing().regressor_count() == 0) continue;
    if (kBlind * sigma < 1) {
      r.identifiable.push_back(kind);
    } else {
      r.not_identifiable.emplace_back(
          kind,
          sigma > 1e8
              ? "this record does not excite it"
              : fmt::format("one sigma is {:.2g} of the smallest size worth reporting", sigma));
    }
  }
}

// What a dead time loses is in proportion to the bus voltage, a device's drop is not: as long as
// that hardly changes they are two names of one loss, whichever the other effects leave a better
// fit.
bool one_bus_voltage(const Record& record) {
  constexpr double kConstantVoltage = 0.02;
  if (record.v_dc.empty()) return true;
  const Eigen::Map<const Eigen::ArrayXd> v(record.v_dc.data(),
                                           static_cast<Eigen::Index>(record.v_dc.size()));
  return (v - v.mean()).square().mean() < kConstantVoltage * kConstantVoltage * v.mean() * v.mean();
}

void name_aliases(const Record& record, TraceResult& r) {
  constexpr std::size_t kMostAliases = 2;
  for (TracedEffect& e : r.effects) {
    const auto lacks = [&](const Traits::Reading* reading) {
      return std::count(e.aliases.begin(), e.aliases.end(), reading->kind) == 0;
    };
    const auto* drop = reading_of(*e.effect, Traits::Reading::kAtOneBusVoltage);
    if (drop && e.aliases.size() < kMostAliases && lacks(drop) && one_bus_voltage(record))
      e.aliases.emplace_back(drop->kind);
    // A torsion that leaves bursts may be a gap, which then is what they are.
    const auto* gap = reading_of(*e.effect, Traits::Reading::kWhereBurstsRemain);
    const bool loose =
        gap && std::erase_if(r.unexplained, [](const Structure& s) { return s.bursts; }) > 0;
    if (loose && lacks(gap)) e.aliases.insert(e.aliases.begin(), gap->kind);
    if (e.aliases.empty()) continue;
    Ambiguity a{.kinds = {std::string(e.effect->kind())}};
    a.kinds.insert(a.kinds.end(), e.aliases.begin(), e.aliases.end());
    a.why = loose ? "the residual beside the shaft comes in bursts, like impacts in a gap"
                  : "they explain this record equally well";
    a.would_separate = what_separates(a.kinds);
    r.ambiguous.push_back(std::move(a));
  }
}

std::string sentence(const TraceResult& r) {
  std::vector<std::string> lacking, too_much;
  for (const TracedEffect& e : r.effects) {
    std::string name(e.effect->kind());
    if (!e.aliases.empty()) name += fmt::format(" (or {})", fmt::join(e.aliases, ", "));
    (takes_back(*e.effect) ? too_much : lacking).push_back(name);
  }
  const bool bus_alone = std::all_of(r.effects.begin(), r.effects.end(),
                                     [](const auto& e) { return e.effect->acts_on() == kOnBus; });
  const auto& main = bus_alone && r.bus                ? r.bus
                     : r.main_equation == "electrical" ? r.electrical
                                                       : r.mechanical;
  std::string fall;
  if (main && !r.effects.empty())
    fall = fmt::format(
        ". With {}, the held-out {} error falls from {:.3g} to {:.3g} {} rms (noise floor {:.3g})",
        !too_much.empty()     ? "this corrected"
        : lacking.size() == 1 ? "it added"
                              : "these added",
        bus_alone && r.bus                ? "bus voltage"
        : r.main_equation == "electrical" ? "voltage"
                                          : "torque",
        main->before.held_out, main->after.held_out, main->unit, main->noise_floor);
  std::string text = "No effect of the catalogue is missing in the model";
  if (!r.effects.empty()) {
    text = "The model";
    if (!lacking.empty()) text += fmt::format(" lacks {}", fmt::join(lacking, ", "));
    if (!lacking.empty() && !too_much.empty()) text += " and";
    if (!too_much.empty()) text += fmt::format(" has too much {}", fmt::join(too_much, ", "));
    text += fall;
  }
  if (!r.unexplained.empty()) {
    std::vector<std::string> what;
    for (const Structure& s : r.unexplained) what.push_back(s.text);
    text += fmt::format(". Outside the catalogue: {}", fmt::join(what, ", "));
  }
  return text + ".";
}

// Which equation leaves plainly more than noise of the sensors makes; empty: none. Of 60 simulated
// logs with nothing missing the worst left 1.07 of it.
std::string more_than_noise(const Fitter& fitter, const Fit& fit) {
  constexpr double kOverNoiseFloor = 1.25;
  const Sampled left = fitter.chain().residual(fit.effects());
  const auto say = [](const char* equation, const char* unit, double square, double noise,
                      Eigen::Index count) {
    if (count == 0 || !(noise > 0) || square < kOverNoiseFloor * kOverNoiseFloor * noise)
      return std::string();
    return fmt::format("the residual of the {} equation is {:.3g} {}, {:.3g} times the noise floor",
                       equation, std::sqrt(square / static_cast<double>(count)), unit,
                       std::sqrt(square / noise));
  };
  const std::string torque = say("torque", "Nm", left.torque.squaredNorm(),
                                 left.noise_torque.squaredNorm(), left.torque.size());
  return !torque.empty()
             ? torque
             : say("voltage", "V", left.d.squaredNorm() + left.q.squaredNorm(),
                   left.noise_d.squaredNorm() + left.noise_q.squaredNorm(), left.d.size());
}

// That nothing was found says nothing of what the record cannot show, or where more is left than
// noise.
void doubt_nothing(const Fitter& fitter, const Fit& fit, TraceResult& r) {
  const std::size_t told = r.identifiable.size(), all = told + r.not_identifiable.size();
  if (4 * told < all) {
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell: of {} kinds of effects {} identifiable in this record. Record a longer run "
        "with several speeds in both directions, load and i_d (twinrate trace --plan proposes "
        "one).",
        all,
        told == 0   ? "none is"
        : told == 1 ? fmt::format("only {} is", r.identifiable[0])
                    : fmt::format("only {} are", fmt::join(r.identifiable, ", ")));
    std::vector<std::string> blind;
    for (const auto& [kind, why] : r.not_identifiable) blind.push_back(kind);
    r.ambiguous.push_back({blind, "this record does not excite them",
                           "a run that varies speed, load and i_d independently (twinrate trace "
                           "--plan proposes one)"});
  } else if (const std::string left = more_than_noise(fitter, fit); !left.empty()) {
    r.verdict = "ambiguous";
    r.sentence = fmt::format(
        "Cannot tell: {}, and this record does not show the cause. Record a longer run with "
        "several speeds in both directions, load and i_d (twinrate trace --plan proposes one).",
        left);
  }
}

}  // namespace

TraceResult conclude(const Fitter& fitter, const Dictionary& dictionary, const Selection& selection,
                     const Health& health, const BusRipple& bus) {
  TraceResult r;
  const Fit& fit = selection.fit;
  const DriveFacts& facts = fitter.chain().equations().facts();
  for (std::size_t m = 0; m < fit.members.size(); ++m) {
    TracedEffect e = traced_effect(fitter, fit, selection.members[m], m);
    if (is_placed(*fit.members[m], Traits::Place::kLine)) {
      r.unexplained.push_back(line_structure(*fit.members[m], selection.members[m]));
      r.stop_gaps.push_back(std::move(e));
      continue;
    }
    for (const Alternative& a : selection.members[m].alternatives)
      r.rejected.push_back({a.kind, a.score_gain, a.held_out_gain,
                            fmt::format("in place of {}: {}", e.effect->kind(), a.why)});
    r.effects.push_back(std::move(e));
  }
  for (const Alternative& a : selection.refused)
    r.rejected.push_back({a.kind, a.score_gain, a.held_out_gain, a.why});
  from_samples(facts, health, r);
  from_bus(bus, r);
  compare_errors(fitter, fit, r);
  add_effect_views(fitter.chain(), fit, r);
  std::vector<TracedEffect> parts;
  for (TracedEffect& e : r.effects)
    for (TracedEffect& part : split_equivalents(std::move(e), facts))
      parts.push_back(std::move(part));
  r.effects = std::move(parts);
  const bool whole = selection.stopped_after == 0;  // else effects to come are in the rest, too
  if (whole &&
      !health.coarse(facts.machine.i_rated))  // else what is left is the shape of the steps
    for (Structure& s : residual_structure(fitter, fit)) r.unexplained.push_back(std::move(s));
  name_aliases(fitter.chain().equations().record(), r);
  r.structured = !r.unexplained.empty();
  r.corrections = corrections_of(r);
  if (whole) {
    identifiability(fitter, dictionary, fit, r);
    const std::string ripple(make_placed(Traits::Place::kBusLine)->kind());
    if (bus.effects.empty() && bus.blind.empty()) r.identifiable.push_back(ripple);
    if (bus.effects.empty() && !bus.blind.empty())
      r.not_identifiable.emplace_back(ripple, bus.blind);
  }
  r.verdict = !r.effects.empty() ? (r.ambiguous.empty() ? "traced" : "ambiguous")
              : r.structured     ? "unexplained"
                                 : "nothing_missing";
  if (!r.effects.empty() && r.structured) r.verdict = "unexplained";
  r.sentence = sentence(r);
  if (selection.stopped_after > 0) {
    r.interrupted = true;
    r.sentence = fmt::format(
        "Interrupted after {} round{} of the selection: more effects may be missing, and those "
        "found are not compared with their alternatives. So far: {}",
        selection.stopped_after, selection.stopped_after == 1 ? "" : "s", r.sentence);
    return r;
  }
  if (r.verdict == "nothing_missing") doubt_nothing(fitter, fit, r);
  return r;
}

}  // namespace twinrate
