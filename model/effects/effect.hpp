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
  double T_load = 0;   // external load, where it is known
  // A, of the terminals' current what goes round the winding that makes the flux (iron_loss).
  Vec2 i_around = Vec2::Zero();
  // cos and sin of theta_e, for whoever has them at hand; zero: they are made where needed.
  Vec2 d_axis = Vec2::Zero();

  Vec2 rotor_axes(const Vec2& alphabeta) const {
    if (d_axis[0] == 0 && d_axis[1] == 0) return park(alphabeta, theta_e);
    return {d_axis[0] * alphabeta[0] + d_axis[1] * alphabeta[1],
            d_axis[0] * alphabeta[1] - d_axis[1] * alphabeta[0]};
  }
  Vec2 stator_axes(const Vec2& dq) const {
    if (d_axis[0] == 0 && d_axis[1] == 0) return inverse_park(dq, theta_e);
    return {d_axis[0] * dq[0] - d_axis[1] * dq[1], d_axis[1] * dq[0] + d_axis[0] * dq[1]};
  }
  // Three phase values as a vector in rotor axes.
  Vec2 phases_to_dq(const Vec3& x_abc) const { return rotor_axes(clarke(x_abc)); }
  // Of the terminals, where resistances, the inverter and the sensors are.
  Vec2 i_terminal() const { return i_dq + i_around; }
  Vec3 i_abc() const { return inverse_clarke(stator_axes(i_terminal())); }
};

// What an effect adds to the equations and readings there.
struct Contribution {
  double T_load = 0;              // Nm, adds to the load
  double J = 0;                   // kgm2, adds to the inertia (acts with the torque)
  Vec2 u_dq_drop = Vec2::Zero();  // V, subtracts from the applied voltage in rotor axes
  // Wb, adds to the flux linkages in rotor axes; the voltage of its change in stator axes, the
  // back-EMF and the torque 3/2 n_p (psi_d i_q - psi_q i_d) follow. A function of i_dq alone.
  Vec2 psi_dq = Vec2::Zero();
  double v_dc = 0;            // V, adds to the DC-bus voltage
  Vec3 i_abc = Vec3::Zero();  // A, adds to what the current sensors read
  double theta_m = 0;         // rad, adds to what the position sensor reads
  double omega_m = 0;         // rad/s, adds to what is read as speed, beyond what follows from
                              // the angle's reading

  Contribution& operator+=(const Contribution& other) {
    T_load += other.T_load;
    J += other.J;
    u_dq_drop += other.u_dq_drop;
    psi_dq += other.psi_dq;
    v_dc += other.v_dc;
    i_abc += other.i_abc;
    theta_m += other.theta_m;
    omega_m += other.omega_m;
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
  kOnFlux = 32,     // psi_dq
  kOnSpeed = 64,    // omega_m
};

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
