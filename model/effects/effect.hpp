// An effect: a property of a real drive that the plain machine equations lack. One file, three
// uses.
//
//   simulate    the plant adds at(point) to its equations and to its sensors
//   regress     the tracer fits a residual on regressors(point), columns that are linear in the
//               parameters, and refines the traced_keys() with at()
//   compensate  estimator and controller predict it with at(point) on their own estimates
//
// An effect may act on several equations at once (flux harmonics: voltage and torque); acts_on()
// lists them, so that an effect is evaluated only where it acts.
//
// The interface has one header a user: physics.hpp (plant, estimator, controller), memory.hpp
// (records), tracing.hpp with traits.hpp (tracer, planner, reports), portrait.hpp (gallery). This
// header knows physics alone.
#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "model/effects/physics.hpp"

namespace twinrate {

class EffectMemory;
class EffectTracing;
class FieldVisitor;
struct DriveFacts;
struct Portrait;

class Effect : public EffectPhysics {
 public:
  virtual std::string_view kind() const = 0;
  virtual std::string_view meaning() const = 0;
  virtual void fields(FieldVisitor& f) = 0;
  // Called once, after fields() and before any use. Returns "" or the data of the drive that are
  // missing, e.g. the number of slots.
  virtual std::string prepare(const DriveFacts&) { return ""; }
  virtual std::shared_ptr<Effect> clone() const = 0;

  // Null for an effect that is a function of the operating point.
  virtual const EffectMemory* memory() const { return nullptr; }
  virtual const EffectTracing& tracing() const = 0;
  virtual EffectTracing& tracing() = 0;
  virtual const Portrait& portrait() const = 0;
};

using Effects = std::vector<std::shared_ptr<const Effect>>;

// The effects that act on any of `mask`.
inline Effects acting_on(const Effects& effects, int mask) {
  Effects some;
  for (const auto& effect : effects)
    if (effect->acts_on() & mask) some.push_back(effect);
  return some;
}

// The point with the terminal current that the effects make.
inline OperatingPoint with_terminals(const Effects& effects, OperatingPoint point) {
  for (const auto& effect : effects) point.i_around += effect->current_around(point);
  return point;
}

inline Contribution sum_at(const Effects& effects, const OperatingPoint& point) {
  const OperatingPoint all = with_terminals(effects, point);
  Contribution total;
  for (const auto& effect : effects) total += effect->at(all);
  return total;
}

// Makes an effect by its kind with default parameters; null if there is no such kind.
std::shared_ptr<Effect> make_effect(std::string_view kind);
std::vector<std::string> effect_kinds();

}  // namespace twinrate
