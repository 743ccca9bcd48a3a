#include "estimator/known_effects.hpp"

#include <algorithm>

#include "model/effects/flux_map.hpp"
#include "model/machine.hpp"
#include "model/point_of.hpp"

namespace twinrate {
namespace {

double voltage_lag(const Effects& effects, double T_s) {
  SamplingFacts late;
  for (const auto& effect : effects) effect->describe_sampling(late);
  const double lag = late.delay[SamplingFacts::kVoltage] + late.lowpass[SamplingFacts::kVoltage];
  return lag > 0 ? std::min(1.0, lag / T_s) : 0;
}

}  // namespace

KnownEffects::KnownEffects(const Effects& effects, const MachineParameters& machine,
                           int current_sensors, double T_s)
    : undo_(effects, machine.n_p, current_sensors, T_s),
      torque_(acting_on(effects, kOnTorque | kOnFlux)),
      voltage_(acting_on(effects, kOnVoltage)),
      flux_(acting_on(effects, kOnFlux)),
      none_(effects.empty()),
      machine_(machine),
      T_s_(T_s),
      voltage_lag_(voltage_lag(effects, T_s)) {}

// `u_dq`: voltage that reaches the machine. Two rounds: the currents half an interval on follow
// from their rate, which follows from them.
Vec2 KnownEffects::flux_voltage(OperatingPoint point, const Vec2& u_dq) const {
  const Vec2 i_dq = point.i_dq;
  const double omega_e = machine_.n_p * point.omega_m;
  FluxMap added;
  Vec2 rate;
  for (int round = 0; round < 2; ++round) {
    added = flux_map(flux_, point);
    rate = current_rate(machine_, added, point.i_dq, u_dq, omega_e);
    point.i_dq = i_dq + 0.5 * T_s_ * rate;
  }
  return omega_e * Vec2(-added.psi[1], added.psi[0]) + added.slope * rate;
}

Measurement KnownEffects::seen(const Measurement& m, const Estimate& last,
                               const Measurement& before) const {
  Measurement s = last.k < 0 ? undo_(m) : undo_(m, last.omega_m);
  if (voltage_lag_ > 0 && before.k == m.k - 1)
    s.u_alphabeta += voltage_lag_ * (before.u_alphabeta - m.u_alphabeta);
  if (last.k < 0 || !(m.signals & kVoltage)) return s;
  if (voltage_.empty() && flux_.empty()) {
    carry_currents(s, last);
    return s;
  }
  // Middle of the interval in which the voltage acted.
  const double theta_m = s.theta_m - 0.5 * T_s_ * last.omega_m;
  const double theta_e = last.theta_e + 0.5 * T_s_ * last.omega_m * machine_.n_p;
  OperatingPoint point =
      point_of(s, {.omega_m = last.omega_m, .theta_m = theta_m, .theta_e = theta_e});
  point.i_dq = last.i_dq;
  Vec2 lost = predicted_drop(voltage_, point);
  if (!flux_.empty()) lost += flux_voltage(point, point.u_dq - lost);
  s.u_alphabeta -= inverse_park(lost, theta_e);
  carry_currents(s, last);
  return s;
}

void KnownEffects::carry_currents(Measurement& s, const Estimate& last) const {
  const double lag = std::min(undo_.current_lag(), T_s_);
  if (lag <= 0 || !(s.signals & kPhaseCurrents)) return;
  const double omega_e = machine_.n_p * last.omega_m, theta_e = last.theta_e + T_s_ * omega_e;
  const Vec2 u_dq = park(s.u_alphabeta, theta_e - 0.5 * lag * omega_e);
  const Vec2 i_dq = park(clarke(s.i_abc), theta_e);
  const Vec2 start_rate = current_rate(machine_, {}, i_dq, u_dq, omega_e);
  const Vec2 rate = current_rate(machine_, {}, i_dq + 0.5 * lag * start_rate, u_dq, omega_e);
  s.i_abc += inverse_clarke(inverse_park(lag * rate, theta_e));
}

}  // namespace twinrate
