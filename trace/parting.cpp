#include "trace/parting.hpp"

#include <algorithm>
#include <cmath>

#include "trace/keys.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {
namespace {

constexpr double kSlope = 0.05;  // of R_s: switches have less
constexpr double kKnown = 3;     // sigmas: a slope that is one

std::map<std::string, double> sigmas_of(const TracedEffect& traced) {
  std::map<std::string, double> sigmas;
  const std::vector<NumericKey> keys = numeric_keys(*traced.effect);
  for (std::size_t i = 0; i < keys.size() && i < traced.parameters.size(); ++i)
    if (traced.parameters[i].sigma) sigmas[keys[i].key] = *traced.parameters[i].sigma;
  return sigmas;
}

TracedEffect in_place_of(const TracedEffect& whole, std::shared_ptr<Effect> part,
                         const std::map<std::string, double>& sigmas, const DriveFacts& facts) {
  part->prepare(facts);
  TracedEffect traced = whole;
  traced.aliases.clear();
  traced.parameters = traced_parameters(*part, sigmas);
  traced.materiality = part->materiality(facts);
  traced.effect = std::move(part);
  return traced;
}

TracedEffect resistance(const TracedEffect& whole, double change, double sigma,
                        const DriveFacts& facts) {
  std::shared_ptr<Effect> part = make_effect("resistance");
  set_key(*part, "change_Ohm", change);
  return in_place_of(whole, std::move(part), {{"change_Ohm", sigma}}, facts);
}

std::vector<TracedEffect> part_asymmetry(TracedEffect whole, const DriveFacts& facts) {
  static const char* const kKeys[] = {"change_a_Ohm", "change_b_Ohm", "change_c_Ohm"};
  // Of one sign: the smallest of them; else nothing.
  const char* least = kKeys[0];
  bool positive = true, negative = true;
  for (const char* key : kKeys) {
    const double change = get_key(*whole.effect, key);
    positive = positive && change > 0;
    negative = negative && change < 0;
    if (std::abs(change) < std::abs(get_key(*whole.effect, least))) least = key;
  }
  if (!positive && !negative) return {std::move(whole)};
  const double common = get_key(*whole.effect, least);
  auto sigmas = sigmas_of(whole);
  TracedEffect same = resistance(whole, common, sigmas[least], facts);
  if (same.materiality < 1) return {std::move(whole)};
  sigmas.erase(least);
  const std::shared_ptr<Effect> rest = whole.effect->clone();
  for (const char* key : kKeys) set_key(*rest, key, get_key(*rest, key) - common);
  return {in_place_of(whole, rest, sigmas, facts), std::move(same)};
}

std::vector<TracedEffect> part_drop(TracedEffect whole, const DriveFacts& facts) {
  const double slope = get_key(*whole.effect, "resistance_Ohm");
  const auto dead_time = equivalent_dead_time(*whole.effect, facts);
  if (slope < kSlope * facts.machine.R_s || !dead_time) return {std::move(whole)};
  auto sigmas = sigmas_of(whole);
  TracedEffect time =
      in_place_of(whole, dead_time,
                  {{"dead_time_s", sigmas["threshold_V"] / (facts.v_dc * facts.f_pwm)},
                   {"linear_current_A", sigmas["linear_current_A"]}},
                  facts);
  if (time.materiality < 1) return {std::move(whole)};
  time.aliases = {"inverter_drop"};
  // A slope without a sigma was not fitted: the record does not separate it from the threshold.
  const auto sigma = sigmas.find("resistance_Ohm");
  if (sigma == sigmas.end() || slope < kKnown * sigma->second) return {std::move(time)};
  return {std::move(time), resistance(whole, slope, sigma->second, facts)};
}

}  // namespace

std::vector<TracedEffect> parted(TracedEffect effect, const DriveFacts& facts) {
  if (effect.effect->kind() == "phase_asymmetry") return part_asymmetry(std::move(effect), facts);
  if (effect.effect->kind() == "inverter_drop") return part_drop(std::move(effect), facts);
  return {std::move(effect)};
}

}  // namespace twinrate
