// Speed ripple of a drive in one process, over the last whole turns.
#pragma once
#include <cmath>

#include "analysis/order_spectrum.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::test {

struct Ripple {
  double rms = 0, harmonics = 0;  // rad/s, whole and orders 1 to 60
  double largest_i_q = 0;         // A, in the whole run
};

// `turns` turns after `settle_s` at a constant speed.
inline Ripple ripple(double speed_rpm, double settle_s, double turns,
                     std::vector<std::string> overrides,
                     const std::string& drive = "niewiara2020") {
  overrides.push_back("reference.speed_rpm=" + std::to_string(speed_rpm));
  Config config = load_drive(drive, overrides);
  ClosedLoop loop(config);
  const double T_s = config.drive().T_s(), end_s = settle_s + (turns + 0.02) * 60 / speed_rpm;
  std::vector<double> theta_m, omega_m;
  Ripple result;
  for (double t_s = 0; t_s < end_s; t_s += T_s) {
    const Truth& truth = loop.step().truth;
    result.largest_i_q = std::max(result.largest_i_q, std::abs(truth.i_dq[1]));
    if (t_s < settle_s) continue;
    theta_m.push_back(truth.theta_m);
    omega_m.push_back(truth.omega_m);
  }
  const OrderSpectrum spectrum = order_spectrum(theta_m, omega_m, 60);
  double sum = 0, sum2 = 0;
  for (std::size_t i = spectrum.first; i < spectrum.last; ++i) {
    sum += omega_m[i];
    sum2 += omega_m[i] * omega_m[i];
  }
  const double count = static_cast<double>(spectrum.last - spectrum.first), mean = sum / count;
  result.rms = std::sqrt(sum2 / count - mean * mean);
  result.harmonics = spectrum.rms(60);
  return result;
}

inline double dB(double ratio) {
  return 20 * std::log10(ratio);
}

}  // namespace twinrate::test
