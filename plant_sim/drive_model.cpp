#include "plant_sim/drive_model.hpp"

#include "plant_sim/fixed_axes.hpp"

namespace twinrate {

Contribution DriveModel::effects_at(const PlantState& x, double t) const {
  return sum_at(effects_, {.t = t,
                           .i_dq = x.head<2>(),
                           .omega_m = x[2],
                           .theta_m = x[3],
                           .theta_e = machine_.n_p * x[3]});
}

double DriveModel::total_load(const PlantState& x, const PlantInput& input,
                              double t_in_interval) const {
  return input.T_load + effects_at(x, input.t_k + t_in_interval).T_load;
}

double DriveModel::torque(const Vec2& i_dq) const {
  return saliency_ == Saliency::kFixedAxes ? fixed_axes_torque(machine_, i_dq[1])
                                           : machine_.torque(i_dq[0], i_dq[1]);
}

PlantState DriveModel::rate(const PlantState& x, const PlantInput& input,
                            double t_in_interval) const {
  const MachineParameters& m = machine_;
  const double i_d = x[0], i_q = x[1], omega_m = x[2], theta_e = m.n_p * x[3];
  const double omega_e = m.n_p * omega_m;
  const Contribution effect = effects_at(x, input.t_k + t_in_interval);
  const Vec2 u_dq = park(input.u_alphabeta, theta_e) - effect.u_dq_drop;
  const double T_load = input.T_load + effect.T_load;
  const double acceleration = (torque(x.head<2>()) - m.B * omega_m - T_load) / m.J;
  if (saliency_ == Saliency::kFixedAxes) {
    const Vec2 i_dq_rate = fixed_axes_current_rate(m, x.head<2>(), u_dq, omega_e, theta_e);
    return {i_dq_rate[0], i_dq_rate[1], acceleration, omega_m};
  }
  return {(u_dq[0] - m.R_s * i_d + omega_e * m.L_q * i_q) / m.L_d,
          (u_dq[1] - m.R_s * i_q - omega_e * (m.L_d * i_d + m.psi_f)) / m.L_q, acceleration,
          omega_m};
}

}  // namespace twinrate
