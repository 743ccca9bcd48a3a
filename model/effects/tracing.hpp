// The interface of tracer and planner: the regression on an effect, and the search for its
// parameters.
//
//   at(point) = sum over r of coefficients()[r] regressors(point)[r]
#pragma once
#include <span>
#include <string>
#include <vector>

#include "model/effects/effect.hpp"
#include "model/effects/traits.hpp"

namespace twinrate {

// A parameter that the tracer fits: a key of fields(), or the index of a choice. The start value of
// a linear parameter comes from the regression on regressors() or, without regressors, on the
// contributions along the record at a small value of it. For the other parameters each value of the
// grid is tried first (empty: moments of the record, every 0.1 s).
struct TracedKey {
  const char* key;
  std::vector<double> grid = {};
  bool refine = true;  // false: stays on the grid (a whole order)
  bool linear = false;
};

class EffectTracing : public TraitNames {
 public:
  virtual ~EffectTracing() = default;
  // One list a kind; of a kind with a choice of signals, those of the signal chosen.
  virtual Traits traits() const = 0;
  // Signals a log must hold before the effect can be traced, as drive-log column names.
  virtual std::vector<std::string> signals_needed() const = 0;

  // coefficients() and the columns of regressors() have regressor_count() entries.
  virtual int regressor_count() const = 0;
  virtual void regressors(const OperatingPoint& point, std::span<Contribution> columns) const = 0;
  virtual void coefficients(std::span<double> values) const = 0;
  // The way back: linear parameters from coefficients.
  virtual void set_coefficients(std::span<const double>) {}

  // Empty: the tracer has no fit for it.
  virtual std::vector<TracedKey> traced_keys() const { return {}; }
  // Its size over the smallest size worth reporting on this drive: below 1 it does not matter.
  virtual double materiality(const DriveFacts&) const { return 0; }
};

// An effect of the catalogue: physics and tracing in one object.
class TraceableEffect : public Effect, public EffectTracing {
 public:
  const EffectTracing& tracing() const final { return *this; }
  EffectTracing& tracing() final { return *this; }
};

}  // namespace twinrate
