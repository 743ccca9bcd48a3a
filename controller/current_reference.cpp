#include "controller/current_reference.hpp"

#include <algorithm>

namespace twinrate {

// The closed form times its conjugate: no division by dL.
Vec2 mtpa(const MachineParameters& machine, double I_s) {
  const double psi_f = machine.psi_f, dL = machine.L_q - machine.L_d;
  const double root = std::sqrt(psi_f * psi_f + 8 * dL * dL * I_s * I_s);
  const double i_d = -2 * dL * I_s * I_s / (psi_f + root);
  return {i_d, std::copysign(std::sqrt(std::max(0.0, I_s * I_s - i_d * i_d)), I_s)};
}

double mtpa_amplitude(const MachineParameters& machine, double i_q) {
  const double psi_f = machine.psi_f, dL = machine.L_q - machine.L_d;
  const double i_d = -2 * dL * i_q * i_q / (psi_f + std::hypot(psi_f, 2 * dL * i_q));
  return std::copysign(std::hypot(i_d, i_q), i_q);
}

// Newton's rule; the torque grows with I_s, at least as fast as the magnets' part of it.
double mtpa_for_torque(const MachineParameters& machine, double T) {
  const double K_t = machine.torque_constant(), dL = machine.L_q - machine.L_d;
  const auto torque = [&](double I_s) {
    const Vec2 i = mtpa(machine, I_s);
    return K_t / machine.psi_f * (machine.psi_f - dL * i[0]) * i[1];
  };
  double I_s = T / K_t;
  for (int i = 0; i < 6; ++i) {
    const double h = 1e-3 * std::max(std::abs(I_s), 1e-3);
    I_s -= (torque(I_s) - T) * 2 * h / (torque(I_s + h) - torque(I_s - h));
  }
  return I_s;
}

FieldWeakening::FieldWeakening(const FieldWeakeningParameters& p, const MachineParameters& machine,
                               double i_max, double T_s)
    : p_(p), L_d_(machine.L_d), psi_f_(machine.psi_f), i_max_(i_max), T_s_(T_s) {}

void FieldWeakening::update(double u_ref, double u_max, double omega_e) {
  if (!p_.active) return;
  // Below the speed at which the magnets alone need half the voltage, i_d is no means to lower it.
  const double omega_0 = 0.5 * u_max / psi_f_;
  const double per_volt = kTwoPi * p_.bandwidth_Hz / (std::max(std::abs(omega_e), omega_0) * L_d_);
  i_d_ = std::clamp(i_d_ - T_s_ * per_volt * (u_ref - p_.margin * u_max), -i_max_, 0.0);
}

// std::clamp selects an address, this a number.
static double clamped(double x, double least, double most) {
  if (x < least) return least;
  return most < x ? most : x;
}

Vec2 limit_current(const Vec2& i_dq_wanted, double i_d_extra, double i_d_fade, double i_max) {
  const double i_d = clamped(i_dq_wanted[0] + i_d_extra, -i_max, i_max);
  const double i_q_max = std::sqrt(i_max * i_max - i_d * i_d);
  const double i_q = clamped(i_dq_wanted[1], -i_q_max, i_q_max);
  if (i_d_fade == 0) return {i_d + i_d_fade, i_q};
  const double i_d_room = std::sqrt(i_max * i_max - i_q * i_q);
  return {std::clamp(i_d + i_d_fade, std::min(i_d, -i_d_room), std::max(i_d, i_d_room)), i_q};
}

}  // namespace twinrate
