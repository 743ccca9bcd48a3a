// An effect: something a real drive does that the plain machine equations lack. One file, three
// uses.
//
//   simulate    the plant adds at(point) to its equations and to its sensors
//   regress     the tracer fits a residual on regressors(point), columns that are linear in the
//               parameters
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
#include "model/frames.hpp"
#include "model/machine.hpp"

namespace twinrate {

// Where on its map the drive stands.
struct OperatingPoint {
  double t = 0;
  Vec2 i_dq = Vec2::Zero();
  Vec2 u_dq = Vec2::Zero();  // voltage the inverter was asked for, limited
  double v_dc = 0;           // without what effects add
  double omega_m = 0;
  double theta_m = 0;
  double theta_e = 0;  // n_p theta_m

  Vec3 i_abc() const { return inverse_clarke(inverse_park(i_dq, theta_e)); }
};

// What an effect adds to the equations and readings there.
struct Contribution {
  double T_load = 0;              // Nm, adds to the load
  double J = 0;                   // kgm2, adds to the inertia (acts with the torque)
  Vec2 u_dq_drop = Vec2::Zero();  // V, subtracts from the applied voltage in rotor axes
  double v_dc = 0;                // V, adds to the DC-bus voltage
  Vec3 i_abc = Vec3::Zero();      // A, adds to what the current sensors read
  double theta_m = 0;             // rad, adds to what the position sensor reads

  Contribution& operator+=(const Contribution& other) {
    T_load += other.T_load;
    J += other.J;
    u_dq_drop += other.u_dq_drop;
    v_dc += other.v_dc;
    i_abc += other.i_abc;
    theta_m += other.theta_m;
    return *this;
  }
};

// Bits of Effect::acts_on.
enum Acts : int {
  kOnTorque = 1,    // T_load, J
  kOnVoltage = 2,   // u_dq_drop
  kOnBus = 4,       // v_dc
  kOnCurrents = 8,  // i_abc
  kOnAngle = 16,    // theta_m
};

// What of the drive an effect may need besides the point.
struct DriveFacts {
  MachineParameters machine;
  double v_dc = 0;   // V, nominal
  double f_pwm = 0;  // Hz
};

// What an effect says of the inverter's legs to a plant that switches them one by one.
struct LegFacts {
  double dead_time = 0;  // s
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

  virtual Contribution at(const OperatingPoint& point) const = 0;

  // The effect as a sum of coefficients() times regressors(): both have regressor_count() entries.
  virtual int regressor_count() const = 0;
  virtual void regressors(const OperatingPoint& point, std::span<Contribution> columns) const = 0;
  virtual void coefficients(std::span<double> values) const = 0;
};

using Effects = std::vector<std::shared_ptr<const Effect>>;

// Those that act on any of `mask`.
inline Effects acting_on(const Effects& effects, int mask) {
  Effects some;
  for (const auto& effect : effects)
    if (effect->acts_on() & mask) some.push_back(effect);
  return some;
}

inline Contribution sum_at(const Effects& effects, const OperatingPoint& point) {
  Contribution total;
  for (const auto& effect : effects) total += effect->at(point);
  return total;
}

// Makes an effect by its kind with default parameters; null where there is no such kind.
std::shared_ptr<Effect> make_effect(std::string_view kind);
std::vector<std::string> effect_kinds();

}  // namespace twinrate
