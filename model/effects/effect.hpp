// An effect: something a real drive does that the plain machine equations lack. One file, three
// uses.
//
//   simulate    the plant adds at(point) to its right-hand side
//   regress     the tracer fits a residual on regressors(point), columns that are linear in the
//   parameters compensate  estimator and controller predict it with at(point) on their own
//   estimates
//
// Torques add to T_load (they oppose positive speed); voltages subtract from the phase voltage in
// rotor axes.
#pragma once
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "model/fields.hpp"
#include "model/frames.hpp"

namespace twinrate {

// Where on its map the drive stands.
struct OperatingPoint {
  double t = 0;
  Vec2 i_dq = Vec2::Zero();
  double omega_m = 0;
  double theta_m = 0;
};

// What an effect adds to the equations there.
struct Contribution {
  double T_load = 0;              // Nm, adds to the load
  Vec2 u_dq_drop = Vec2::Zero();  // V, subtracts from the applied voltage
  Contribution& operator+=(const Contribution& other) {
    T_load += other.T_load;
    u_dq_drop += other.u_dq_drop;
    return *this;
  }
};

class Effect {
 public:
  virtual ~Effect() = default;
  virtual std::string_view kind() const = 0;
  virtual std::string_view meaning() const = 0;
  // Signals a log must hold before the effect can be traced, as drive-log column names.
  virtual std::vector<std::string> signals_needed() const = 0;
  virtual void fields(FieldVisitor& f) = 0;
  virtual std::shared_ptr<Effect> clone() const = 0;

  virtual Contribution at(const OperatingPoint& point) const = 0;

  // The effect as a sum of coefficients() times regressors(): both have regressor_count() entries.
  virtual int regressor_count() const = 0;
  virtual void regressors(const OperatingPoint& point, std::span<Contribution> columns) const = 0;
  virtual void coefficients(std::span<double> values) const = 0;
};

using Effects = std::vector<std::shared_ptr<const Effect>>;

inline Contribution sum_at(const Effects& effects, const OperatingPoint& point) {
  Contribution total;
  for (const auto& effect : effects) total += effect->at(point);
  return total;
}

// Makes an effect by its kind with default parameters; null where there is no such kind.
std::shared_ptr<Effect> make_effect(std::string_view kind);
std::vector<std::string> effect_kinds();

}  // namespace twinrate
