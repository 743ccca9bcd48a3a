// Load torque and speed over the angle of the rotor, in stretches of a run in which nothing else
// changes.
#pragma once
#include <string>
#include <vector>

#include "analysis/order_spectrum.hpp"
#include "report/parts.hpp"

namespace twinrate::report {

inline constexpr int kRippleOrders = 60;

// A stretch of constant compensation, from where reference and load are constant, too, and
// settle_s (or half of the stretch, if that is less) later; then its last whole turns.
struct Stretch {
  double begin_s = 0;           // where the compensation was switched
  double from_s = 0, to_s = 0;  // of the whole turns
  std::string compensation;     // its name; empty where the controller has none
  OrderSpectrum spectrum;       // of omega_m, orders 1 to kRippleOrders
  double rms = 0;               // of omega_m less its mean
  double mean = 0;
};

// True speed, or the slope of the measured position, of every stretch with a whole turn in it.
std::vector<Stretch> ripple_stretches(const RunView& view);

// theta_m and T_load_hat of the last stretch, and their spectrum up to `N_max`.
struct TorqueOverAngle {
  std::vector<double> theta_m, T_load_hat, T_load;  // T_load: NaN without truth
  OrderSpectrum spectrum;
};
TorqueOverAngle torque_over_angle(const RunView& view, int N_max);

// rms falls from `before` to `after`: 20 log10(before/after), as text with sign: "-5.1 dB".
std::string change_dB(double before, double after);

}  // namespace twinrate::report
