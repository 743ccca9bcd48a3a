// A synthetic run at constant speed.
#pragma once
#include <limits>

#include "analysis/summary.hpp"

namespace twinrate {

inline constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
inline constexpr double kOmegaM = 50;  // speed of the synthetic runs, mechanical

inline DriveConfig steady_drive() {
  DriveConfig config;
  config.machine.n_p = 4;
  config.rates.f_s_Hz = 1000;
  config.rates.n = 5;
  config.rates.n_from = NFrom::kStart;
  config.rates.f_b_Hz = 200;
  config.run.duration_s = 2;
  config.run.settle_s = 0.5;
  return config;
}

// A run at constant speed with an exact estimate; the tests modify it.
inline RunLog steady_run(const DriveConfig& config) {
  RunLog log;
  for (std::int64_t k = 0; k < config.steps(); ++k) {
    const double t = static_cast<double>(k) * config.T_s();
    Truth truth;
    truth.k = k;
    truth.t_ns = config.t_ns(k);
    truth.theta_m = kOmegaM * t;
    truth.omega_m = kOmegaM;
    Measurement m;
    m.k = k;
    m.t_ns = truth.t_ns;
    m.signals = kPhaseCurrents | kPosition | kSpeed;
    m.theta_m = truth.theta_m;
    m.omega_m = truth.omega_m;
    Estimate e;
    e.k = k;
    e.t_ns = truth.t_ns;
    e.gain_seq = k < config.rates.n ? -1 : k / config.rates.n * config.rates.n - config.rates.n;
    e.theta_e = wrap_turn(config.machine.n_p * truth.theta_m);
    e.omega_m = truth.omega_m;
    Command c;
    c.k = k;
    c.t_ns = truth.t_ns;
    c.omega_m_ref = kOmegaM;
    log.truth.push_back(truth);
    log.measurement.push_back(m);
    log.estimate.push_back(e);
    log.command.push_back(c);
    if (k % config.rates.n != 0) continue;
    Gain g;
    g.k = k;
    g.t_ns = truth.t_ns;
    g.n_x = 4, g.n_y = 2;
    g.P(3, 3) = k < 500 ? 9.0 : 0.4 + 1e-5 * static_cast<double>(k);
    log.gain.push_back(g);
  }
  return log;
}

}  // namespace twinrate
