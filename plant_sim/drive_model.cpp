#include "plant_sim/drive_model.hpp"

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

PlantState DriveModel::rate(const PlantState& x, const PlantInput& input,
                            double t_in_interval) const {
  const MachineParameters& m = machine_;
  const double i_d = x[0], i_q = x[1], omega_m = x[2], theta_e = m.n_p * x[3];
  const double omega_e = m.n_p * omega_m;
  const Contribution effect = effects_at(x, input.t_k + t_in_interval);
  const Vec2 u_dq = park(input.u_alphabeta, theta_e) - effect.u_dq_drop;
  const double T_load = input.T_load + effect.T_load;
  return {(u_dq[0] - m.R_s * i_d + omega_e * m.L_q * i_q) / m.L_d,
          (u_dq[1] - m.R_s * i_q - omega_e * (m.L_d * i_d + m.psi_f)) / m.L_q,
          (m.torque(i_d, i_q) - m.B * omega_m - T_load) / m.J, omega_m};
}

}  // namespace twinrate
