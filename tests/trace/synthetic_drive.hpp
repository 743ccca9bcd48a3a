// An independent drive model for the tests of the tracer, without code of the product's plant.
// Isotropic machine, RK4 in stator axes, varying speed and load, ideal current control.
#pragma once
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "core/config.hpp"
#include "model/random.hpp"
#include "trace/health.hpp"

namespace twinrate {

struct SyntheticDrive {
  double R = 1.05, L = 12.7e-3, psi = 0.253333333333, J = 8.8e-3, B = 0.003;
  int n_p = 3;
  double T_s = 1e-4, duration_s = 6;
  std::uint64_t seed = 1;
  bool quiet = false;  // standstill
  bool slow = false;   // a twentieth of the speed, no i_d
  bool held = false;   // the first speed, load and i_d throughout
  std::function<double(double t, double theta, double omega)> extra_load =
      [](double, double, double) { return 0.0; };
  double R_extra = 0, offset_a = 0;  // ohm; A, of sensor a
  double R_warm = 0, warm_s = 2;     // ohm that a winding gains, with this time constant
  double offset_theta = 0;           // rad, of the encoder
  double loss_V = 0, loss_A = 0.12;  // a leg loses loss_V sign(i), less below loss_A
  bool smooth_loss = false;          // loss_V tanh(i/loss_A) instead
  double i_noise = 0.008, lsb = 0.009765625;
  int counts = 1048576;                   // of the encoder, which rounds down
  double speeds = 1, loads = 1, i_d = 1;  // of those of the servo
  double omega_more = 0;                  // rad/s, beyond the servo's speed
  double dither = 0;                      // V rms, of the reference
};

// Its declared model.
inline const DriveConfig& servo() {
  static const Config config =
      Config::parse(Config::load("niewiara2020").resolved_with({}), "test");
  return config.drive();
}

inline double wanted_speed(double t) {
  return 45 * std::sin(1.3 * t) + 25 * std::sin(2.9 * t + 1);
}
inline double external_load(double t) {
  return std::fmod(t, 1.7) > 0.9 ? 1.8 : -0.4;
}

// The second mass behind a gap, in forty steps a sample. Without a gap the shaft never separates.
struct LooseLoad {
  double J = 3.2e-3, K = 600, D = 0.45, gap = 0.02;
  double t = 0, theta = 0.3, omega = wanted_speed(0), torque = 0;
  double operator()(double time, double theta_m, double omega_m) {
    const int steps = 20;  // in half a sample
    const double h = (time - t) / steps;
    for (int j = 0; j < steps && h > 0; ++j) {
      const double delta = theta_m - (1 - (j + 0.5) / steps) * h * steps * omega_m - theta;
      const double beyond = std::abs(delta) - 0.5 * gap, sign = delta > 0 ? 1 : -1;
      const double push = K * beyond + D * sign * (omega_m - omega);
      torque = gap == 0 || (beyond > 0 && push > 0) ? sign * push : 0;
      omega += h * (torque - external_load(t)) / J;
      theta += h * omega;
    }
    t = time;
    return torque - external_load(time);  // torque at the motor without the load
  }
};

inline RawLog simulate_synthetic(const SyntheticDrive& d) {
  RawLog raw;
  raw.path = "synthetic";
  const double share = d.speeds * (d.quiet ? 0 : d.slow ? 0.05 : 1);  // of the speed
  double i_d = 0, i_q = 0, omega = d.omega_more + share * wanted_speed(0), theta = 0.3;
  const auto n = static_cast<std::size_t>(d.duration_s / d.T_s);
  for (std::size_t k = 0; k < n; ++k) {
    const double t = static_cast<double>(k) * d.T_s;
    const double of = d.held ? 0 : t;  // time of the wanted motion
    const double T_load = d.quiet ? 0 : d.loads * external_load(of);
    // Readings.
    const double a = d.n_p * theta;
    const double i_al = std::cos(a) * i_d - std::sin(a) * i_q,
                 i_be = std::sin(a) * i_d + std::cos(a) * i_q;
    const auto read = [&](double i, std::uint64_t stream) {
      return std::round((i + d.i_noise * normal(d.seed, stream, k)) / d.lsb) * d.lsb;
    };
    raw.t.push_back(t);
    raw.i_a.push_back(read(i_al + d.offset_a, 0));
    raw.i_b.push_back(read(-0.5 * i_al + 0.5 * std::sqrt(3.0) * i_be, 1));
    raw.i_c.push_back(-raw.i_a.back() - raw.i_b.back());
    const double step = 2 * 3.14159265358979323846 / d.counts;
    raw.theta_m.push_back(std::floor((theta + d.offset_theta) / step) * step);
    raw.v_dc.push_back(235.4 + 0.2 * normal(d.seed, 2, k));
    raw.T_load.push_back(T_load);
    // The voltage reference of a controller with its own model, constant in stator axes.
    const double K_t = 1.5 * d.n_p * d.psi;
    const double accel =
        d.held ? 0 : share * (wanted_speed(t + 1e-3) - wanted_speed(t - 1e-3)) / 2e-3;
    const double i_q_ref =
        d.quiet ? 0
                : (d.J * (accel + 30 * (d.omega_more + share * wanted_speed(of) - omega)) + T_load +
                   d.B * omega) /
                      K_t;
    const double i_d_ref = d.quiet || d.slow ? 0 : d.i_d * (std::fmod(of, 1.1) > 0.6 ? -1.2 : 0.5);
    const double omega_e = d.n_p * omega, k_p = 2 * 3.14159 * 250 * d.L;
    const auto dither = [&](std::uint64_t stream) {
      return d.dither > 0 ? d.dither * normal(d.seed, stream, k) : 0;
    };
    const double u_d = k_p * (i_d_ref - i_d) + d.R * i_d - omega_e * d.L * i_q + dither(3);
    const double u_q =
        k_p * (i_q_ref - i_q) + d.R * i_q + omega_e * (d.L * i_d + d.psi) + dither(4);
    const double mid = a + 0.5 * omega_e * d.T_s;
    const double u_al = std::cos(mid) * u_d - std::sin(mid) * u_q,
                 u_be = std::sin(mid) * u_d + std::cos(mid) * u_q;
    raw.u_alpha.push_back(u_al);
    raw.u_beta.push_back(u_be);
    const auto lost = [&](double i) {
      return d.loss_V *
             (d.smooth_loss ? std::tanh(i / d.loss_A) : std::clamp(i / d.loss_A, -1.0, 1.0));
    };
    // RK4 over the interval: i_d, i_q, omega, theta.
    using State = std::array<double, 4>;
    const auto rate = [&](const State& x, double time) -> State {
      const double e = d.n_p * x[3], w = d.n_p * x[2];
      const double al = std::cos(e) * x[0] - std::sin(e) * x[1],
                   be = std::sin(e) * x[0] + std::cos(e) * x[1], half = 0.5 * std::sqrt(3.0) * be;
      const double lost_a = lost(al), lost_b = lost(half - 0.5 * al),
                   lost_c = lost(-half - 0.5 * al);
      const double left_al = u_al - (2 * lost_a - lost_b - lost_c) / 3,
                   left_be = u_be - (lost_b - lost_c) / std::sqrt(3.0);
      const double ud = std::cos(e) * left_al + std::sin(e) * left_be,
                   uq = -std::sin(e) * left_al + std::cos(e) * left_be;
      const double R = d.R + d.R_extra + d.R_warm * -std::expm1(-time / d.warm_s);
      const double load = T_load + d.extra_load(time, x[3], x[2]);
      const double torque = d.quiet ? 0 : (K_t * x[1] - d.B * x[2] - load) / d.J;
      return {(ud - R * x[0] + w * d.L * x[1]) / d.L,
              (uq - R * x[1] - w * (d.L * x[0] + d.psi)) / d.L, torque, x[2]};
    };
    State x{i_d, i_q, omega, theta};
    const double h = d.T_s;
    const auto plus = [](const State& x0, const State& r, double f) {
      State y = x0;
      for (int j = 0; j < 4; ++j)
        y[static_cast<std::size_t>(j)] += f * r[static_cast<std::size_t>(j)];
      return y;
    };
    const State k1 = rate(x, t), k2 = rate(plus(x, k1, h / 2), t + h / 2),
                k3 = rate(plus(x, k2, h / 2), t + h / 2), k4 = rate(plus(x, k3, h), t + h);
    for (std::size_t j = 0; j < 4; ++j) x[j] += h / 6 * (k1[j] + 2 * k2[j] + 2 * k3[j] + k4[j]);
    i_d = x[0], i_q = x[1], omega = x[2], theta = x[3];
  }
  return raw;
}

}  // namespace twinrate
