// Bandwidths of the current and the speed loop of `foc`, from J, K_t, f_s and the filter.
//
//   T_d       = (delay_samples + 1/2) T_s       delay of the voltage
//   f_c       = 0.06/T_d                        phase margin 90 deg - 360 deg f_c T_d = 68 deg
//   f_c,most  = 1/(6 T_d)                       the same, 30 deg
//   f_w,least = 0.835/(0.1 2 pi t_m)            t_m = J omega_rated/T_rated: a step of rated torque
//                                               makes the speed dip by 10 % of the rated speed
//   f_w,most  = min(f_c/5, 0.9 f_filter) f_filter: of the slowest pole of the filter's error,
//                                               if the loop uses its angle; above it check warns
//   f_w       = f_s/625, within these limits; if they contradict each other, f_w,most, and the dip
//             is
//               larger
//   K_p       = 2 pi f_w J/K_t
//
// A step of rated torque, with the integral of controller/pi.hpp, makes the speed dip by
//
//   0.835 T_rated/(2 pi f_w J)                  at 2.66/(2 pi f_w)
#pragma once
#include <optional>

#include "core/config.hpp"
#include "estimator/filter.hpp"

namespace twinrate {

struct Bandwidths {
  double current_Hz = 0, current_most_Hz = 0;
  double speed_Hz = 0, speed_least_Hz = 0, speed_most_Hz = 0;
  std::optional<double> filter_Hz;  // at the slowest speed of the reference
  double K_p_As_rad = 0;
  double dip_rad_s = 0, dip_at_s = 0;  // mechanical
};

// Hz, of the slowest pole of the filter's error at `omega_e` with a gain every tick; none if the
// filter has no steady state or is unstable there.
std::optional<double> filter_bandwidth(const std::shared_ptr<const Filter>& filter,
                                       const DriveConfig& drive, double omega_e);

// Requires read_all_tables(). Throws BadInput as make_filter().
Bandwidths suggest_bandwidths(Config& config);

}  // namespace twinrate
