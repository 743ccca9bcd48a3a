#include "loop/bandwidths.hpp"

#include <algorithm>
#include <limits>

#include "estimator/make_filter.hpp"
#include "loop/closed_floquet.hpp"
#include "model/math.hpp"
#include "model/per_unit.hpp"

namespace twinrate {
namespace {

constexpr double kCurrentLoop = 0.06, kCurrentLoopMost = 1.0 / 6;  // of 1/T_d
constexpr double kSpeedOverCurrent = 0.2, kSpeedOverFilter = 0.9;
constexpr double kSamplesABandwidth = 625;  // of the speed loop
constexpr double kDip = 0.835, kDipAt = 2.66;
constexpr double kWantedDip = 0.1;  // of the rated speed, at a step of rated torque

// Electrical, of the steps that are not zero; 0 without one.
double slowest_reference(const DriveConfig& d) {
  const Profile& profile = d.reference.in_rpm ? d.reference.speed_rpm : d.reference.omega_e_rad_s;
  const double to_omega_e = d.reference.in_rpm ? kTwoPi / 60 * d.machine.n_p : 1;
  double slowest = std::numeric_limits<double>::infinity();
  for (const ProfileStep& step : profile.steps())
    if (step.value != 0) slowest = std::min(slowest, std::abs(step.value) * to_omega_e);
  return std::isfinite(slowest) ? slowest : 0;
}

}  // namespace

std::optional<double> filter_bandwidth(const std::shared_ptr<const Filter>& filter,
                                       const DriveConfig& d, double omega_e) {
  if (!filter->steady_state(0)) return std::nullopt;
  const Steady steady{filter,
                      GainPolicy::kPaper,
                      omega_e / d.machine.n_p,
                      omega_e,
                      d.T_s(),
                      d.gain.speed_span / d.machine.n_p};
  const double rho = spectral_radius(steady, 1);
  if (!(rho < 1)) return std::nullopt;
  return -math::log(rho) / (kTwoPi * d.T_s());
}

Bandwidths suggest_bandwidths(Config& config) {
  const DriveConfig& d = config.drive();
  const MachineParameters& m = d.machine;
  const PerUnit base = per_unit(m, d.inverter.v_dc, d.T_s());
  const double T_d = (d.plant.delay_samples + 0.5) * d.T_s();
  Bandwidths b;
  b.current_Hz = kCurrentLoop / T_d;
  b.current_most_Hz = kCurrentLoopMost / T_d;
  b.speed_least_Hz = kDip / (kWantedDip * kTwoPi * base.t_m);
  b.speed_most_Hz = kSpeedOverCurrent * b.current_Hz;
  if (const double omega_e = slowest_reference(d);
      d.controller.angle_source == AngleSource::kEstimate && omega_e > 0)
    b.filter_Hz = filter_bandwidth(make_filter(config), d, omega_e);
  if (b.filter_Hz) b.speed_most_Hz = std::min(b.speed_most_Hz, kSpeedOverFilter * *b.filter_Hz);
  b.speed_Hz =
      std::min(std::max(d.rates.f_s_Hz / kSamplesABandwidth, b.speed_least_Hz), b.speed_most_Hz);
  b.K_p_As_rad = kTwoPi * b.speed_Hz * m.J / m.torque_constant();
  b.dip_rad_s = kDip * base.T / (kTwoPi * b.speed_Hz * m.J);
  b.dip_at_s = kDipAt / (kTwoPi * b.speed_Hz);
  return b;
}

}  // namespace twinrate
