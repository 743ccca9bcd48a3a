// Raw constants of a machine, and the check that every quantity fits its format (formats.hpp). For the
// host: it computes in double.
#pragma once
#include <cmath>
#include <cstdint>

#include "firmware/cortex_m3/two_rate.hpp"

namespace twinrate::m3 {

struct Machine {
  double R_s, L, psi_f, T_s;                // Ohm, H, Wb, s
  double Q_diag[4], R_diag[2], P0_diag[4];  // A^2, (rad/s)^2, rad^2
  double i_range = 16;                      // largest measured |i_alpha|, |i_beta|, A
  double u_max;                             // largest |u|, V
  double omega_max = 2500;                  // clamp, electrical rad/s
  double P33_max = 65536;                   // clamp, (rad/s)^2
  double P44_max = 4;                       // clamp, rad^2: an unknown angle has pi^2/3
  double P34_max = 150;                     // clamp, rad^2/s
};

inline std::int32_t to_raw(double value, int bits) {
  return static_cast<std::int32_t>(std::llround(std::ldexp(value, bits)));
}

// theta_e in rad, of any turn -> 2^32 a turn.
inline std::uint32_t angle_raw(double theta_e) {
  return static_cast<std::uint32_t>(std::llround(std::ldexp(theta_e / (2 * kPi), 32)));
}
inline double angle_of(std::uint32_t raw) {
  return std::ldexp(2 * kPi * raw, -32);
}

// Units of a format.
template <class Q>
struct Units {
  double speed = std::ldexp(1.0, Q::kSpeedLog2);       // rad/s
  double angle = std::ldexp(2 * kPi, -Q::kAngleLog2);  // rad
  double of_state(int i) const { return i < 2 ? 1 : i == 2 ? speed : angle; }
  double of_P(int i, int j) const { return of_state(i) * of_state(j); }
};

inline StepConstants step_constants(const Machine& m) {
  const double z = m.T_s * m.R_s / m.L, b = m.T_s * m.psi_f / m.L;
  // omega_e raw is 2^19 per rad/s, theta_e raw 2^32 a turn.
  const double T = m.T_s * std::ldexp(1.0, 32 - kSpeedRawLog2) / (2 * kPi);
  return {to_raw(-z, kStepBits), to_raw(m.T_s / m.L, kStepBits), to_raw(T, kStepBits),
          to_raw(b, kEmfConstantBits), to_raw(m.omega_max, kSpeedRawLog2)};
}

template <class Q>
CovarianceConstants covariance_constants(const Machine& m) {
  const Units<Q> unit;
  const double z = m.T_s * m.R_s / m.L, b = m.T_s * m.psi_f / m.L;
  CovarianceConstants c{};
  c.minus_z = to_raw(-z, Q::kF);
  c.T = to_raw(m.T_s * unit.speed / unit.angle, Q::kF);
  c.b_speed = to_raw(b * unit.speed, 32);
  c.b_angle = to_raw(b * unit.angle, 42 - Q::kHead);
  for (int i = 0; i < 4; ++i) {
    c.Q[i] = to_raw(m.Q_diag[i] / unit.of_P(i, i), Q::kP);
    c.P0[i] = to_raw(m.P0_diag[i] / unit.of_P(i, i), Q::kP);
  }
  for (int j = 0; j < 2; ++j) {
    c.R_P[j] = to_raw(m.R_diag[j], Q::kP);
    c.R_K[j] = to_raw(m.R_diag[j], Q::kR);
  }
  c.P22_max = to_raw(m.P33_max / unit.of_P(2, 2), Q::kP);
  c.P33_max = to_raw(m.P44_max / unit.of_P(3, 3), Q::kP);
  c.P23_max = to_raw(m.P34_max / unit.of_P(2, 3), Q::kP);
  return c;
}

// One quantity and the limit of its format; every quantity must fit.
struct Range {
  const char* quantity;
  double bound, fits;
  bool holds() const { return std::abs(bound) < fits; }
};

inline constexpr int kRanges = 12;
struct Ranges {
  Range at[kRanges];
  const Range* first_that_fails() const {
    for (const Range& r : at)
      if (!r.holds()) return &r;
    return nullptr;
  }
};

// (a), (b) and (c) of formats.hpp.
template <class Q>
Ranges check_ranges(const Machine& m) {
  const Units<Q> unit;
  const double z = m.T_s * m.R_s / m.L, g = m.T_s / m.L, b = m.T_s * m.psi_f / m.L;
  const double y = std::sqrt(2.0) * m.i_range, drive = g * m.u_max + b * m.omega_max;
  double i_prior = 0;
  for (int step = 0; step < 10000; ++step) i_prior = (1 - z) * std::hypot(i_prior, y) + drive;
  const double R = std::fmin(m.R_diag[0], m.R_diag[1]), R_max = std::fmax(m.R_diag[0], m.R_diag[1]);
  const double P22 = std::fmax(m.P33_max, m.P0_diag[2]) / unit.of_P(2, 2),
               P33 = std::fmax(m.P44_max, m.P0_diag[3]) / unit.of_P(3, 3),
               P00 = std::fmax(R_max, std::fmax(m.P0_diag[0], m.P0_diag[1]));
  const double g02 = b * unit.speed, g03 = b * m.omega_max * unit.angle;
  const double T = m.T_s * unit.speed / unit.angle;
  const double P00_prior =
      std::pow((1 - z) * std::sqrt(P00) + g02 * std::sqrt(P22) + g03 * std::sqrt(P33), 2) +
      std::fmax(m.Q_diag[0], m.Q_diag[1]);
  const double P22_prior = P22 + m.Q_diag[2] / unit.of_P(2, 2);
  const double P33_prior =
      std::pow(std::sqrt(P33) + T * std::sqrt(P22), 2) + m.Q_diag[3] / unit.of_P(3, 3);
  const double P_fits = std::ldexp(1.0, (Q::kP == 20 ? 31 : 15) - Q::kP);
  const double K_fits = std::ldexp(1.0, (Q::kK == 25 ? 31 : 15) - Q::kK);
  const double F_fits = std::ldexp(1.0, (Q::kF == 32 ? 31 : 15) - Q::kF);
  return {{{"u, V", m.u_max, 64},
           {"i, A", std::hypot(i_prior, y), 64},
           {"innovation, A", m.i_range + i_prior, 64},
           {"b omega_e, A", b * m.omega_max, 32},
           {"z and T_s/L", std::fmax(z, g), 0.5},
           {"b 2^38 and b 2^kSpeedLog2", std::fmax(b * unit.speed * 4, b * 64 * 4) / 4, 0.5},
           {"F - I", std::fmax(std::fmax(z, T), std::fmax(g02, g03)), F_fits},
           {"P^-_00 + R", P00_prior + R_max, P_fits},
           {"P^-_22", P22_prior, P_fits},
           {"P^-_33", P33_prior, P_fits},
           {"K", std::sqrt(std::fmax(P22_prior, P33_prior) / R), K_fits},
           // unequal R, or R outside [1, 4) A^2: the bounds of i and of S^-1 do not hold
           {"R", R >= 1 && R == R_max ? R_max : INFINITY, 4}}};
}

}  // namespace twinrate::m3
