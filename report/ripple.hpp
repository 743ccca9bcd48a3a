// Load torque and speed over the angle of the rotor, in stretches of constant conditions.
#pragma once
#include <string>
#include <vector>

#include "analysis/order_spectrum.hpp"
#include "report/parts.hpp"

namespace twinrate::report {

inline constexpr int kRippleOrders = 60;

// The last whole turns of a stretch with constant compensation, reference and load. The first
// settle_s of the stretch (at most half of it) are not used.
struct Stretch {
  double begin_s = 0;           // switching of the compensation
  double from_s = 0, to_s = 0;  // of the whole turns
  std::string compensation;     // its name; empty if the controller has none
  OrderSpectrum spectrum;       // of omega_m, orders 1 to kRippleOrders
  double rms = 0;               // of omega_m less its mean
  double mean = 0;
  double drift =
      0;  // mean of the last turn less that of the first: no ripple, but in rms and orders
};

// All stretches with at least one whole turn; from the true speed or the slope of the measured
// position.
std::vector<Stretch> ripple_stretches(const RunView& view);

// theta_m and T_load_hat of the last stretch, and their spectrum up to `N_max`.
struct TorqueOverAngle {
  std::vector<double> theta_m, T_load_hat, T_load;  // T_load: NaN without truth
  OrderSpectrum spectrum;
};
TorqueOverAngle torque_over_angle(const RunView& view, int N_max);

// 20 log10(after/before) as text with sign, such as "-5.1 dB".
std::string change_dB(double before, double after);

}  // namespace twinrate::report
