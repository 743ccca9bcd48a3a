// An effect: something a real drive does that the plain machine equations lack. One file, three
// uses.
//
//   simulate    the plant adds at(point) to its equations and to its sensors
//   regress     the tracer fits a residual on regressors(point), columns that are linear in the
//               parameters, and refines the traced_keys() by what at() gives
//   compensate  estimator and controller predict it with at(point) on their own estimates
//
// An effect may act on several equations at once (flux harmonics: voltage and torque); acts_on()
// says which, so that nobody evaluates what cannot concern him.
#pragma once
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "model/fields.hpp"
#include "model/machine.hpp"
#include "model/operating_point.hpp"

namespace twinrate {

// What of the drive an effect may need besides the point.
struct DriveFacts {
  MachineParameters machine;
  double v_dc = 0;   // V, nominal
  double f_pwm = 0;  // Hz
  double T_s = 0;    // s, for which the controller holds a voltage; 0: not known
};

// What an effect says of the inverter's legs to a plant that switches them one by one.
struct LegFacts {
  double dead_time = 0;  // s
};

// The rotor's second mass behind a shaft: what it takes of machine.J, and the shaft between.
//   T_shaft = K (delta less the gap) + D delta',  0 inside the gap;  delta = theta_m - theta_load
//
// Across a gap the flanks only push: where the sum would pull it is 0.
struct ShaftFacts {
  double J_load = 0;     // kgm2, of machine.J
  double stiffness = 0;  // Nm/rad; 0: no shaft, one rigid mass
  double damping = 0;    // Nms/rad
  double gap = 0;        // rad, whole free play
};

// What an effect does to the samples themselves, beyond adding to a reading.
struct SamplingFacts {
  enum Signal : int { kVoltage = 0, kCurrent = 1, kAngle = 2, kSpeed = 3 };
  double delay[4] = {0, 0, 0, 0};    // s, by Signal
  double lowpass[4] = {0, 0, 0, 0};  // s, time constant of a first-order filter, by Signal
  double i_lsb = 0;                  // A, ADC step beyond that of the sensors; 0: none
  double i_limit = 0;                // A, the ADC's range; 0: unlimited
  double missing = 0, stale = 0;     // share of rows that are lost; that repeat the row before
  double held = 0;                   // share of rows whose currents alone do
};

// What the tracer fits: a key of fields(); of a choice the position. The start of a linear
// parameter comes from the regression on regressors(), or, where there are none, on along() at a
// small value of it; the others are tried at each value of the grid first (empty: moments of the
// record, every 0.1 s).
struct TracedKey {
  const char* key;
  std::vector<double> grid = {};
  bool refine = true;  // false: stays on the grid (a whole order)
  bool linear = false;
};

class Effect {
 public:
  virtual ~Effect() = default;
  virtual std::string_view kind() const = 0;
  virtual std::string_view meaning() const = 0;
  virtual int acts_on() const = 0;
  // Signals a log must hold before the effect can be traced, as drive-log column names.
  virtual std::vector<std::string> signals_needed() const = 0;
  virtual void fields(FieldVisitor& f) = 0;
  // Called once, after fields() and before anything below. Returns "" or what of the drive is
  // lacking, e.g. the number of slots.
  virtual std::string prepare(const DriveFacts&) { return ""; }
  virtual std::shared_ptr<Effect> clone() const = 0;
  // True where a switched inverter does itself what at() averages: the facts then replace at().
  virtual bool describe_legs(LegFacts&) const { return false; }

  // True where the plant has to carry a second mass; where it has to spoil samples.
  virtual bool describe_shaft(ShaftFacts&) const { return false; }
  virtual bool describe_sampling(SamplingFacts&) const { return false; }
  // True where its torque acts behind the shaft, where there is one, as the declared load does.
  virtual bool behind_shaft() const { return false; }

  // True where what it drops follows the angle smoothly between samples, as no current does.
  virtual bool drops_by_angle() const { return false; }
  // True where its first coefficient is the size of a loss (losses.hpp).
  virtual bool is_loss() const { return false; }

  // What it adds to i_around.
  virtual Vec2 current_around(const OperatingPoint&) const { return Vec2::Zero(); }

  virtual Contribution at(const OperatingPoint& point) const = 0;
  // The same along a record, T_s apart: for effects with a memory (a shaft, a lag), whose at() is
  // zero.
  virtual void along(std::span<const OperatingPoint> record, double /*T_s*/,
                     std::span<Contribution> sums) const {
    for (std::size_t k = 0; k < record.size(); ++k) sums[k] = at(record[k]);
  }

  // The effect as a sum of coefficients() times regressors(): both have regressor_count() entries.
  virtual int regressor_count() const = 0;
  virtual void regressors(const OperatingPoint& point, std::span<Contribution> columns) const = 0;
  virtual void coefficients(std::span<double> values) const = 0;
  // The way back: linear parameters from coefficients.
  virtual void set_coefficients(std::span<const double>) {}

  // Empty: the tracer has no fit for it.
  virtual std::vector<TracedKey> traced_keys() const { return {}; }
  // Its size over the smallest that is worth reporting on this drive: below 1 it does not matter.
  virtual double materiality(const DriveFacts&) const { return 0; }
};

using Effects = std::vector<std::shared_ptr<const Effect>>;

// Those that act on any of `mask`.
inline Effects acting_on(const Effects& effects, int mask) {
  Effects some;
  for (const auto& effect : effects)
    if (effect->acts_on() & mask) some.push_back(effect);
  return some;
}

// The point with the terminals' current that they make.
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

// Makes an effect by its kind with default parameters; null where there is no such kind.
std::shared_ptr<Effect> make_effect(std::string_view kind);
std::vector<std::string> effect_kinds();

}  // namespace twinrate
