#include "trace/either_meaning.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

constexpr double kSame = 0.5;  // of the larger of two values

bool is_near(double a, double b) {
  return std::abs(a - b) <= kSame * std::max(std::abs(a), std::abs(b));
}

// A parameter that one result leaves near zero has no size to compare.
bool is_large(const TracedParameter& p) {
  return std::abs(p.value) > 2 * *p.sigma;
}

bool agree(const TracedEffect& one, const TracedEffect& other) {
  if (one.effect->kind() != other.effect->kind() ||
      one.parameters.size() != other.parameters.size() ||
      !is_near(one.materiality, other.materiality))
    return false;
  for (std::size_t k = 0; k < one.parameters.size(); ++k) {
    const TracedParameter &a = one.parameters[k], &b = other.parameters[k];
    if (a.text != b.text || a.sigma.has_value() != b.sigma.has_value()) return false;
    if (a.sigma && (is_large(a) || is_large(b)) && !is_near(a.value, b.value)) return false;
  }
  return true;
}

const TracedEffect* partner(const TracedEffect& e, const TraceResult& in) {
  const auto found = std::find_if(in.effects.begin(), in.effects.end(),
                                  [&](const TracedEffect& other) { return agree(e, other); });
  return found == in.effects.end() ? nullptr : &*found;
}

bool includes(const std::vector<std::string>& all, const std::vector<std::string>& some) {
  return std::all_of(some.begin(), some.end(), [&](const std::string& kind) {
    return std::find(all.begin(), all.end(), kind) != all.end();
  });
}

bool names_effects_alone(const TraceResult& r) {
  return (r.verdict == "traced" || r.verdict == "ambiguous") && !r.effects.empty() &&
         !r.interrupted;
}

// True if no claim was refused and the torque has a structure that remains: the meaning of the
// voltage does not change it.
bool leaves_torque_alone(const TraceResult& r) {
  return r.verdict == "unexplained" && !r.interrupted && r.refused.empty() &&
         !r.unexplained.empty() &&
         std::all_of(r.unexplained.begin(), r.unexplained.end(),
                     [](const Structure& s) { return s.equation == "mechanical"; });
}

// `r` with the uncertainty of its meaning; empty if an effect lacks a partner that it covers.
std::optional<TraceResult> covering(TraceResult r, const TraceResult& other) {
  for (TracedEffect& e : r.effects) {
    const TracedEffect* same = partner(e, other);
    if (!same || !includes(e.aliases, same->aliases)) return std::nullopt;
    for (std::size_t k = 0; k < e.parameters.size(); ++k) {
      TracedParameter& p = e.parameters[k];
      if (p.sigma) p.sigma = std::max(*p.sigma, std::abs(p.value - same->parameters[k].value));
    }
  }
  std::erase_if(r.identifiable, [&](const std::string& kind) {
    if (includes(other.identifiable, {kind})) return false;
    r.not_identifiable.emplace_back(kind, "only one meaning of the voltage would show it");
    return true;
  });
  return r;
}

bool acts_on_voltage(const TraceResult& r) {
  return std::any_of(r.effects.begin(), r.effects.end(), [](const TracedEffect& e) {
    return !e.from_samples && e.equation != "mechanical";
  });
}

// Energy per row that the voltage equation leaves of the rows that judge, beyond its noise.
double beyond_noise(const EquationError& e) {
  return std::max(0., e.after.held_out * e.after.held_out - e.noise_floor * e.noise_floor);
}

}  // namespace

bool explains_alone(const TraceResult& one, const TraceResult& other) {
  constexpr double kHalf = 0.5;
  return names_effects_alone(one) && acts_on_voltage(one) && one.electrical && other.electrical &&
         std::any_of(other.unexplained.begin(), other.unexplained.end(),
                     [](const Structure& s) { return s.equation == "electrical"; }) &&
         beyond_noise(*one.electrical) < kHalf * beyond_noise(*other.electrical);
}

std::optional<TraceResult> shown_by_both(const TraceResult& first, const TraceResult& second) {
  const auto usable = [](const TraceResult& r) {
    return names_effects_alone(r) || leaves_torque_alone(r);
  };
  if (!usable(first) || !usable(second) || !acts_on_voltage(first) ||
      first.effects.size() != second.effects.size())
    return std::nullopt;
  const bool first_leaves = leaves_torque_alone(first), second_leaves = leaves_torque_alone(second);
  std::optional<TraceResult> r;
  if (first_leaves || !second_leaves) r = covering(first, second);
  if (!r && (second_leaves || !first_leaves)) r = covering(second, first);
  return r;
}

}  // namespace twinrate
