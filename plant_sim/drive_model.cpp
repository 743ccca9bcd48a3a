#include "plant_sim/drive_model.hpp"

#include <algorithm>

#include "model/effects/flux_map.hpp"
#include "model/math.hpp"
#include "model/point_of.hpp"
#include "plant_sim/fixed_axes.hpp"

namespace twinrate {
namespace {

ShaftFacts shaft_of(const Effects& effects) {
  ShaftFacts facts;
  for (const auto& effect : effects) effect->describe_shaft(facts);
  return facts;
}

Effects of_load_side(const Effects& effects, bool load_side) {
  Effects some;
  for (const auto& effect : effects)
    if (effect->behind_shaft() == load_side) some.push_back(effect);
  return some;
}

}  // namespace

DriveModel::DriveModel(const MachineParameters& machine, const Effects& effects, double v_dc,
                       Saliency saliency)
    : machine_(machine),
      shaft_(shaft_of(effects)),
      on_equations_(acting_on(effects, kOnTorque | kOnVoltage)),
      on_load_(has_shaft() ? of_load_side(on_equations_, true) : Effects{}),
      on_flux_(acting_on(effects, kOnFlux)),
      on_bus_(acting_on(effects, kOnBus)),
      on_sensors_(acting_on(effects, kOnCurrents | kOnAngle | kOnSpeed)),
      acts_on_currents_(!acting_on(effects, kOnCurrents).empty()),
      acts_on_angle_(!acting_on(effects, kOnAngle).empty()),
      v_dc_(v_dc),
      saliency_(saliency) {
  if (has_shaft()) on_equations_ = of_load_side(on_equations_, false);
}

bool DriveModel::is_plain() const {
  return saliency_ == Saliency::kRotor && !has_shaft() && on_equations_.empty() &&
         on_flux_.empty() && on_bus_.empty();
}

std::optional<Vec2> DriveModel::constant_voltage(const PlantInput& input) const {
  if (!input.legs) return input.u_alphabeta;
  for (const Leg leg : input.legs->legs)
    if (leg == Leg::kDead) return {};
  return input.legs->u_alphabeta(Vec3::Zero(), v_dc_);
}

double DriveModel::fastest_rate() const {
  const double electrical = machine_.R_s / std::min(machine_.L_d, machine_.L_q);
  if (!has_shaft()) return electrical;
  const double J = std::min(shaft_.J_load, machine_.J - shaft_.J_load);
  return std::max({electrical, std::sqrt(shaft_.stiffness / J), shaft_.damping / J});
}

OperatingPoint DriveModel::point(const PlantState& x, const PlantInput& input,
                                 double t_in_interval) const {
  OperatingPoint p =
      point_of(input.t_k + t_in_interval, frame_at(x[3], x[2], machine_.n_p), x.head<2>());
  const auto [s, c] = math::sincos(p.theta_e);
  p.d_axis = {c, s};
  p.v_dc = v_dc_;
  p.T_load = input.T_load;
  if (input.legs) {
    const Vec3 i_abc = with_terminals(on_equations_, p).i_abc();
    p.u_dq = p.rotor_axes(input.legs->u_alphabeta(i_abc, v_dc_));
  } else {
    p.u_dq = p.rotor_axes(input.u_alphabeta);
  }
  if (!on_bus_.empty()) p.u_dq *= (v_dc_ + sum_at(on_bus_, p).v_dc) / v_dc_;
  return p;
}

double DriveModel::total_load(const PlantState& x, const PlantInput& input,
                              double t_in_interval) const {
  if (on_equations_.empty() && on_load_.empty()) return input.T_load;
  const OperatingPoint p = point(x, input, t_in_interval);
  return input.T_load + sum_at(on_equations_, p).T_load + sum_at(on_load_, p).T_load;
}

double DriveModel::bus_voltage(const PlantState& x, const PlantInput& input,
                               double t_in_interval) const {
  if (on_bus_.empty()) return v_dc_;
  return v_dc_ + sum_at(on_bus_, point(x, input, t_in_interval)).v_dc;
}

Contribution DriveModel::sensing_at(const PlantState& x, const PlantInput& input,
                                    double t_in_interval) const {
  if (on_sensors_.empty()) return {};
  return sum_at(on_sensors_, point(x, input, t_in_interval));
}

double DriveModel::torque(const Vec2& i_dq) const {
  if (saliency_ == Saliency::kFixedAxes) return fixed_axes_torque(machine_, i_dq[1]);
  const double T_em = machine_.torque(i_dq[0], i_dq[1]);
  if (on_flux_.empty()) return T_em;
  return T_em - flux_load(machine_.n_p, sum_at(on_flux_, {.i_dq = i_dq}).psi_dq, i_dq);
}

PlantState DriveModel::rate(const PlantState& x, const PlantInput& input,
                            double t_in_interval) const {
  return motor_rate(x, input, t_in_interval, input.T_load, machine_.J);
}

TwoMassState DriveModel::two_mass_rate(const TwoMassState& x, const PlantInput& input,
                                       double t_in_interval) const {
  const double delta = x[4], omega_load = x[5], delta_rate = x[2] - omega_load;
  const double T_shaft = shaft_torque(shaft_, delta, delta_rate);
  const double T_load = load_behind_shaft(point(x.head<4>(), input, t_in_interval));
  TwoMassState rate;
  rate << motor_rate(x.head<4>(), input, t_in_interval, T_shaft, machine_.J - shaft_.J_load),
      delta_rate, (T_shaft - T_load) / shaft_.J_load;
  return rate;
}

double DriveModel::load_behind_shaft(const OperatingPoint& point) const {
  return point.T_load + (on_load_.empty() ? 0 : sum_at(on_load_, point).T_load);
}

ShaftState DriveModel::shaft_at_rest(double t, double omega_m, double T_load) const {
  if (!has_shaft()) return {};
  const double behind = load_behind_shaft({.t = t, .omega_m = omega_m, .T_load = T_load});
  return twinrate::shaft_at_rest(shaft_, omega_m, behind);
}

PlantState DriveModel::motor_rate(const PlantState& x, const PlantInput& input,
                                  double t_in_interval, double T_external, double J) const {
  const MachineParameters& m = machine_;
  const double i_d = x[0], i_q = x[1], omega_m = x[2];
  const double omega_e = m.n_p * omega_m;
  const OperatingPoint p = point(x, input, t_in_interval);
  const Contribution effect = sum_at(on_equations_, p);
  const Vec2 u_dq = p.u_dq - effect.u_dq_drop;
  const double T_load = T_external + effect.T_load;
  const double acceleration = (torque(x.head<2>()) - m.B * omega_m - T_load) / (J + effect.J);
  if (saliency_ == Saliency::kFixedAxes) {
    const Vec2 i_dq_rate = fixed_axes_current_rate(m, x.head<2>(), u_dq, omega_e, p.theta_e);
    return {i_dq_rate[0], i_dq_rate[1], acceleration, omega_m};
  }
  if (!on_flux_.empty()) {
    const Vec2 i_dq_rate = current_rate(m, flux_map(on_flux_, p), x.head<2>(), u_dq, omega_e);
    return {i_dq_rate[0], i_dq_rate[1], acceleration, omega_m};
  }
  return {(u_dq[0] - m.R_s * i_d + omega_e * m.L_q * i_q) / m.L_d,
          (u_dq[1] - m.R_s * i_q - omega_e * (m.L_d * i_d + m.psi_f)) / m.L_q, acceleration,
          omega_m};
}

}  // namespace twinrate
