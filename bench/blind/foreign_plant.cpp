#include "bench/blind/foreign_plant.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate::blind {
namespace {

constexpr double kTurn = 6.283185307179586;
constexpr double kRoot3 = 1.7320508075688772;

double sign_of(double x) {
  return x < 0 ? -1 : 1;
}

}  // namespace

void ForeignPlant::place(double theta, double omega) {
  state_ = {0, 0, omega, theta, omega, theta};
}

double ForeignPlant::bus_voltage(double t) const {
  return v_dc_ + x_.bus_V * std::sin(kTurn * x_.bus_Hz * t + x_.bus_phase);
}

ForeignPlant::Vector ForeignPlant::terminal_current(const State& s) const {
  Vector i(s[kCurrentD], s[kCurrentQ]);
  if (x_.R_iron > 0) {
    const Vector psi((m_.L_d + x_.L_d_change) * i.real() + m_.psi_f + x_.psi_change,
                     (m_.L_q + x_.L_q_change) * i.imag());
    i += Vector(0, m_.n_p * s[kOmega] / x_.R_iron) * psi;
  }
  return i * std::polar(1.0, m_.n_p * s[kTheta]);
}

// The voltage of a star behind the drops of its legs.
ForeignPlant::Vector ForeignPlant::winding_voltage(const State& s, Vector u) const {
  const Vector i = terminal_current(s);
  const double a = i.real(), b = -0.5 * a + 0.5 * kRoot3 * i.imag();
  const auto drop = [this](double of_leg) {
    return x_.drop_V * std::clamp(of_leg / x_.drop_zone_A, -1.0, 1.0) + x_.drop_Ohm * of_leg;
  };
  const double lost_a = drop(a) + x_.R_a * a - x_.offset_a_V, lost_b = drop(b) - x_.offset_b_V,
               lost_c = drop(-a - b);
  return u - Vector((2 * lost_a - lost_b - lost_c) / 3, (lost_b - lost_c) / kRoot3);
}

double ForeignPlant::load_torque(const State& s) const {
  const double omega = s[kOmega], theta = s[kTheta];
  return (m_.B + x_.viscous) * omega + x_.fan * omega * std::abs(omega) +
         x_.eccentric * std::sin(theta + x_.eccentric_phase) +
         x_.cogging * std::sin(x_.cogging_order * theta + x_.cogging_phase) +
         std::tanh(omega / 0.05) * x_.ripple * std::sin(x_.ripple_order * theta + x_.ripple_phase);
}

double ForeignPlant::shaft_torque(const State& s) const {
  const double twist = s[kTheta] - s[kThetaLoad], slip = s[kOmega] - s[kOmegaLoad];
  if (x_.gap == 0) return x_.stiffness * twist + x_.damping * slip;
  const double beyond = std::abs(twist) - 0.5 * x_.gap, side = sign_of(twist);
  const double push = x_.stiffness * beyond + x_.damping * side * slip;
  return beyond > 0 && push > 0 ? side * push : 0;
}

// `torque`: of all but the dry friction.
double ForeignPlant::speed_rate(const State& s, double torque, double J, double step) const {
  const double omega = s[kOmega];
  const double dry = x_.coulomb + x_.stribeck * std::exp(-std::pow(omega / x_.stribeck_speed, 2));
  if (!x_.sticks) return (torque - dry * std::tanh(omega / 0.05)) / J;
  const double at_rest = 1e-4 * m_.omega_m_rated;
  if (std::abs(omega) >= at_rest) return (torque - dry * sign_of(omega)) / J;
  if (std::abs(torque) <= dry) return -omega / (2 * step);
  return (torque - dry * sign_of(torque)) / J;
}

ForeignPlant::State ForeignPlant::rate(const State& s, double t, Vector u, double T_load,
                                       double step) const {
  const double omega = s[kOmega], omega_e = m_.n_p * omega, i_d = s[kCurrentD], i_q = s[kCurrentQ];
  const Vector frame = std::polar(1.0, -m_.n_p * s[kTheta]);
  const Vector u_dq = frame * winding_voltage(s, u), i_dq = frame * terminal_current(s);
  const double warm = x_.R_tau > 0 ? -std::expm1(-std::max(0.0, t) / x_.R_tau) : 1;
  const double R = m_.R_s + x_.R_change * warm;
  const double L_d = m_.L_d + x_.L_d_change, L_q = m_.L_q + x_.L_q_change;
  const double fill = x_.saturation_A > 0 ? 1 + std::abs(i_q) / x_.saturation_A : 1;
  const double psi_q = L_q * i_q / fill, slope_q = L_q / (fill * fill);
  const double phase = x_.harmonic_order * s[kTheta] + x_.harmonic_phase;
  const double psi = m_.psi_f + x_.psi_change + x_.harmonic * std::cos(phase);
  const double psi_slope = -x_.harmonic * x_.harmonic_order * std::sin(phase);  // Wb/rad
  State d{};
  d[kCurrentD] = (u_dq.real() - R * i_dq.real() - psi_slope * omega + omega_e * psi_q) / L_d;
  d[kCurrentQ] = (u_dq.imag() - R * i_dq.imag() - omega_e * (L_d * i_d + psi)) / slope_q;
  const double torque =
      1.5 * m_.n_p * ((psi + L_d * i_d) * i_q - psi_q * i_d) + 1.5 * psi_slope * i_d;
  const double outer = T_load + x_.constant + (t >= x_.t_step ? x_.step : 0);
  const double J = m_.J + x_.J_change - x_.J_load;
  const bool two_masses = x_.J_load > 0;
  const double shaft = two_masses ? shaft_torque(s) : outer;
  d[kOmega] = speed_rate(s, torque - load_torque(s) - shaft, J, step);
  d[kTheta] = omega;
  d[kOmegaLoad] = two_masses ? (shaft - outer) / x_.J_load : d[kOmega];
  d[kThetaLoad] = two_masses ? s[kOmegaLoad] : omega;
  return d;
}

void ForeignPlant::advance(double t, double T_s, Vector u, Vector u_before, double T_load) {
  const int steps = x_.gap > 0 ? 16 : x_.sticks ? 8 : 6;
  const double h = T_s / steps, asked_for = bus_voltage(t);
  for (int j = 0; j < steps; ++j) {
    const double at = t + j * h;
    const double before = std::clamp((x_.late_voltage_s - j * h) / h, 0.0, 1.0);
    const Vector asked = before * u_before + (1 - before) * u;
    const Vector applied = asked * (1 + x_.gain) * bus_voltage(at + 0.5 * h) / asked_for;
    const auto after = [](State s, const State& d, double by) {
      for (std::size_t k = 0; k < s.size(); ++k) s[k] += by * d[k];
      return s;
    };
    const State a = rate(state_, at, applied, T_load, h),
                b = rate(after(state_, a, h / 2), at + h / 2, applied, T_load, h),
                c = rate(after(state_, b, h / 2), at + h / 2, applied, T_load, h),
                d = rate(after(state_, c, h), at + h, applied, T_load, h);
    for (std::size_t k = 0; k < state_.size(); ++k)
      state_[k] += h / 6 * (a[k] + 2 * b[k] + 2 * c[k] + d[k]);
  }
}

}  // namespace twinrate::blind
