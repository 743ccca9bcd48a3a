#include "controller/scaled_tuning.hpp"

#include <algorithm>
#include <cmath>

#include "model/per_unit.hpp"

namespace twinrate {
namespace {

constexpr double kOverload = 1.5;       // i_max over the rated current
constexpr double kSettled = 5;          // of 90 deg, exp(-5) leaves 0.6 deg
constexpr double kLongestAlign_s = 10;  // the largest value of the key

// Of psi_f/(L_q - L_d), the i_start without active flux. The remaining flux makes the EMF of the
// hand-over and the stiffness i (1 - share), which is largest at 0.5; a larger share carries more
// load. Kim's motor, lqr, four loads and two rotor angles: eemf locks 5 of 8 starts with 0.9, 8
// with 0.65, 6 with 0.5.
constexpr double kStartCurrent = 0.65;

PerUnit base_of(const DriveConfig& c) {
  return per_unit(c.machine, c.inverter.v_dc, c.T_s());
}

double speed_bandwidth(const DriveConfig& c, double current_bandwidth) {
  const double slowest = 2 / (kTwoPi * base_of(c).t_m);
  return std::clamp(std::max(c.rates.f_s_Hz / 625, slowest), 0.01, current_bandwidth / 5);
}

// Rate at which the rotor settles on the vector of an alignment, 1/s: the slower root of
//
//   J s^2 + D s + k,  D = 3/2 n_p^2 psi_f^2 R_s/(R_s^2 + omega_n^2 L_q^2)
//   k = n_p K_t i (1 - (L_q - L_d) i/psi_f),  with L_q > L_d
//
// D is the damping by the currents that the rotor's EMF drives through R_s and L_q, at omega_n^2 =
// k/J, or at rest if the motion is overdamped.
double settling_rate(const MachineParameters& m, double i) {
  const double flux_left = 1 - std::max(0.0, m.L_q - m.L_d) * i / m.psi_f;
  const double k = m.n_p * m.torque_constant() * i * flux_left, flux = m.n_p * m.psi_f;
  const double X2 = k / m.J * m.L_q * m.L_q;
  const double D_rest = 1.5 * flux * flux / m.R_s;
  const double D = D_rest / (1 + X2 / (m.R_s * m.R_s));
  if (D * D < 4 * m.J * k) return D / (2 * m.J);
  return (D_rest - std::sqrt(D_rest * D_rest - 4 * m.J * k)) / (2 * m.J);
}

// i_start 0 means i_max.
void scale(StartupParameters& p, const DriveConfig& c, double i_max) {
  const MachineParameters& m = c.machine;
  if (m.L_q > m.L_d) p.i_start = kStartCurrent * m.psi_f / (m.L_q - m.L_d);
  const double i_start = p.i_start > 0 ? std::min(p.i_start, i_max) : i_max;
  p.t_align = std::clamp(kSettled / settling_rate(m, i_start), p.t_align, kLongestAlign_s);
  p.omega_e_handover = 0.1 * base_of(c).omega_e;
  p.acceleration = 0.02 * m.n_p * m.torque_constant() * i_start / m.J;
}

// The paper's largest deviations in the sizes of its motor, and the weights that follow from them.
void scale_deviations(LqrDesignParameters& p, const PerUnit& base, int n_p) {
  const double omega_m = base.omega_e / n_p;
  p.deviation_d[0] = 0.566 * base.i;
  p.deviation_d[1] = 0.0156 * base.i;
  p.deviation_q[0] = 1.9 * base.i;
  p.deviation_q[1] = 0.82 * omega_m;
  p.deviation_q[2] = 2.3e-3 * omega_m;
  for (int i = 0; i < 2; ++i) p.Q_d[i] = 1 / (p.deviation_d[i] * p.deviation_d[i]);
  for (int i = 0; i < 3; ++i) p.Q_q[i] = 1 / (p.deviation_q[i] * p.deviation_q[i]);
}

void scale(SynchronismParameters& p, const PerUnit& base) {
  p.innovation = 8.2e-3 * base.i;
  p.omega_e_min = 0.12 * base.omega_e;
}

}  // namespace

void scale(FocParameters& p, const DriveConfig& c) {
  const PerUnit base = base_of(c);
  p.current_bandwidth = std::clamp(c.rates.f_s_Hz / 25, 1.0, 5000.0);
  p.speed_bandwidth = speed_bandwidth(c, p.current_bandwidth);
  p.i_max = kOverload * base.i;
  scale(p.startup, c, p.i_max);
  scale(p.synchronism, base);
}

void scale(LqrParameters& p, const DriveConfig& c) {
  const MachineParameters& m = c.machine;
  const double f_s = c.rates.f_s_Hz, decay = 1.1 * m.R_s / (kTwoPi * std::min(m.L_d, m.L_q));
  const double current = std::max(f_s / 40, decay);
  const double speed = speed_bandwidth(c, current);
  scale_deviations(p.design, base_of(c), m.n_p);
  p.design.gains = GainSource::kBandwidths;
  p.design.bandwidth_d_Hz[0] = current;
  p.design.bandwidth_d_Hz[1] = speed / 2;
  p.design.bandwidth_q_Hz[0] = current;
  p.design.bandwidth_q_Hz[1] = speed;
  p.design.bandwidth_q_Hz[2] = speed / 2;
  p.i_max = kOverload * base_of(c).i;
  scale(p.startup, c, p.i_max);
  scale(p.synchronism, base_of(c));
}

}  // namespace twinrate
