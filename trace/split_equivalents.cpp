#include "trace/split_equivalents.hpp"

#include <algorithm>
#include <cmath>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {
namespace {

constexpr double kSlope = 0.05;  // of R_s: the slope of switches is smaller
constexpr double kKnown = 3;     // sigmas that a slope, or a part beyond the common one, needs
// Sigmas that a common part needs beside different phases. By design above kKnown: it is the
// smallest of three changes, and a missing effect biases all three. One drawn log is its reason.
constexpr double kCommon = 5;

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
  traced.materiality = part->tracing().materiality(facts);
  traced.effect = std::move(part);
  return traced;
}

// The effect of a reading of which all keys correspond to one key of that effect.
TracedEffect part_of(const TracedEffect& whole, const Traits::Reading& reading, double value,
                     double sigma, const DriveFacts& facts) {
  std::shared_ptr<Effect> part = make_effect(reading.kind);
  const char* key = reading.keys.begin()->to;
  set_key(*part, key, value);
  return in_place_of(whole, std::move(part), {{key, sigma}}, facts);
}

std::vector<TracedEffect> split_asymmetry(TracedEffect whole, const Traits::Reading& reading,
                                          const DriveFacts& facts) {
  std::vector<const char*> keys;
  for (const Traits::KeyPair& pair : reading.keys) keys.push_back(pair.from);
  // The common part is the smallest of the changes if all have one sign; else there is none.
  const char* least = keys[0];
  bool positive = true, negative = true;
  for (const char* key : keys) {
    const double change = get_key(*whole.effect, key);
    positive = positive && change > 0;
    negative = negative && change < 0;
    if (std::abs(change) < std::abs(get_key(*whole.effect, least))) least = key;
  }
  if (!positive && !negative) return {std::move(whole)};
  const double common = get_key(*whole.effect, least);
  auto sigmas = sigmas_of(whole);
  TracedEffect same = part_of(whole, reading, common, sigmas[least], facts);
  if (same.materiality < 1) return {std::move(whole)};
  const double of_least = sigmas[least];
  sigmas.erase(least);
  const std::shared_ptr<Effect> rest = whole.effect->clone();
  bool known = false;
  for (const char* key : keys) {
    const double beyond = get_key(*rest, key) - common;
    set_key(*rest, key, beyond);
    const auto sigma = sigmas.find(key);
    known = known ||
            (beyond != 0 && (sigma == sigmas.end() ||
                             std::abs(beyond) >= kKnown * std::hypot(sigma->second, of_least)));
  }
  if (!known) return {std::move(same)};
  if (std::abs(common) < kCommon * of_least) return {std::move(whole)};
  return {in_place_of(whole, rest, sigmas, facts), std::move(same)};
}

std::vector<TracedEffect> split_drop(TracedEffect whole, const Traits::Reading& reading,
                                     const DriveFacts& facts) {
  const char* slope_key = reading.keys.begin()->from;
  const double slope = get_key(*whole.effect, slope_key);
  const auto dead_time = equivalent_dead_time(*whole.effect, facts);
  if (slope < kSlope * facts.machine.R_s || !dead_time) return {std::move(whole)};
  auto sigmas = sigmas_of(whole);
  TracedEffect time =
      in_place_of(whole, dead_time,
                  {{"dead_time_s", sigmas["threshold_V"] / (facts.v_dc * facts.f_pwm)},
                   {"linear_current_A", sigmas["linear_current_A"]}},
                  facts);
  if (time.materiality < 1) return {std::move(whole)};
  time.aliases = {std::string(whole.effect->kind())};
  // A slope without a sigma was not fitted: the record does not separate it from the threshold.
  const auto sigma = sigmas.find(slope_key);
  if (sigma == sigmas.end() || slope < kKnown * sigma->second) return {std::move(time)};
  return {std::move(time), part_of(whole, reading, slope, sigma->second, facts)};
}

}  // namespace

std::vector<TracedEffect> split_equivalents(TracedEffect effect, const DriveFacts& facts,
                                            const Considered& considered) {
  const auto other = [&](Traits::Reading::When when) -> const Traits::Reading* {
    const Traits::Reading* reading = reading_of(*effect.effect, when);
    return reading && considered(reading->kind) ? reading : nullptr;
  };
  if (const auto* common = other(Traits::Reading::kItsCommonPart))
    return split_asymmetry(std::move(effect), *common, facts);
  const auto *slope = other(Traits::Reading::kItsSlope),
             *threshold = other(Traits::Reading::kItsThreshold);
  if (slope && threshold) return split_drop(std::move(effect), *slope, facts);
  return {std::move(effect)};
}

}  // namespace twinrate
