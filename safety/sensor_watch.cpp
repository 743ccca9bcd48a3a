#include "safety/sensor_watch.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "model/math.hpp"

namespace twinrate {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kStuckTurn = 2;  // rad: a sine moves by half its amplitude at least

// Into (-pi, pi].
double wrapped(double angle) {
  // Spares the division where nothing is to be wrapped. + 0.0: -0 becomes 0, as below.
  if (std::abs(angle) < kPi) return angle + 0.0;
  return angle - 2 * kPi * std::ceil(angle / (2 * kPi) - 0.5);
}

}  // namespace

double SensorWatch::Vector::norm() const {
  return std::sqrt(alpha * alpha + beta * beta);
}

SensorWatch::Currents SensorWatch::Vector::phases() const {
  const double half = 0.5 * std::numbers::sqrt3 * beta;
  return {alpha, -0.5 * alpha + half, -0.5 * alpha - half};
}

SensorWatch::Vector SensorWatch::vector_of(const Currents& i) {
  return {(2 * i[0] - i[1] - i[2]) / 3, (i[1] - i[2]) / std::numbers::sqrt3};
}

SensorWatch::Vector SensorWatch::predicted_current(double turned) const {
  const Vector i = vector_of(good_.i_abc);
  const auto [s, c] = math::sincos(turned);
  return {c * i.alpha - s * i.beta, s * i.alpha + c * i.beta};
}

// The speed is that of the readings or of the voltage's frame, whichever is the larger: neither is
// sure.
double SensorWatch::jump_bound(const AppliedVoltage& applied, double turned,
                               const Vector& i) const {
  const double of_frame = std::abs(turned) / limits_.T_s;
  const double omega_e = std::max(of_frame, std::abs(limits_.n_p * good_.omega_m));
  const double amplitude = std::max(i.norm(), vector_of(good_.i_abc).norm());
  const double u = std::max(applied.u, u_before_);
  const double by_voltage =
      limits_.T_s / limits_.L *
      (u + limits_.psi_f * omega_e + limits_.R_s * amplitude + limits_.v_floor);
  const double by_turning = omega_e * limits_.T_s * limits_.L_ratio * amplitude;
  return kJumpMargin * (by_voltage + by_turning) + limits_.i_floor;
}

bool SensorWatch::stuck(const Currents& i, double turned) {
  bool one = false, none_changed = true;
  for (std::size_t p = 0; p < 3; ++p) {
    const std::array<double, 2> others = {i[(p + 1) % 3], i[(p + 2) % 3]};
    if (i[p] != raw_[p]) {
      turned_same_[p] = 0;
      at_change_[p] = others;
      none_changed = false;
      continue;
    }
    turned_same_[p] += std::abs(turned);
    const double moved =
        std::max(std::abs(others[0] - at_change_[p][0]), std::abs(others[1] - at_change_[p][1]));
    one = one || (turned_same_[p] > kStuckTurn && moved > limits_.i_moved);
    none_changed = none_changed && turned_same_[p] > 2 * kPi;
  }
  return one || (none_changed && vector_of(i).norm() > 0.5 * limits_.i_moved);
}

int SensorWatch::check_currents(Currents& i, const AppliedVoltage& applied, double turned) {
  const Vector predicted = predicted_current(turned);
  const double sum = i[0] + i[1] + i[2];
  int fault = 0;
  if (!std::isfinite(sum)) {
    fault = kCurrentsNotFinite;
  } else {
    const bool is_stuck = stuck(i, turned);
    raw_ = i;
    const Vector is = vector_of(i);
    const double apart = Vector{is.alpha - predicted.alpha, is.beta - predicted.beta}.norm();
    // The bound is i_floor at least.
    const bool jumps = apart > limits_.i_floor && apart > jump_bound(applied, turned, predicted);
    const bool sum_is_off = limits_.i_sum > 0 && std::abs(sum) > limits_.i_sum;
    if (is_stuck)
      fault = kCurrentsStuck;
    else if (sum_is_off || jumps)
      fault = kCurrentsJump;
  }
  if (fault != 0) i = predicted.phases();
  return fault;
}

int SensorWatch::check_position(SensorReadings& r) {
  int fault = 0;
  const double predicted = good_.theta_m + good_.omega_m * limits_.T_s;
  if (!std::isfinite(r.theta_m) || !std::isfinite(r.omega_m))
    fault = kPositionNotFinite;
  else if (std::abs(r.theta_m - predicted) > limits_.step_max)
    fault = kPositionJump;
  if (fault == 0) return 0;
  r.theta_m = predicted;
  r.omega_m = good_.omega_m;
  return fault;
}

[[gnu::flatten]] int SensorWatch::check(SensorReadings& r, const AppliedVoltage& applied,
                                        bool measured) {
  // The first angle of a frame, and a jump of it, give no speed.
  double turned = begun_ ? wrapped(applied.theta_e - theta_e_) : 0;
  if (!std::isfinite(turned)) turned = omega_e_ * limits_.T_s;
  int faults = 0;
  if (!begun_) {
    const double sum = r.i_abc[0] + r.i_abc[1] + r.i_abc[2];
    good_ = r;
    if (!std::isfinite(sum)) good_.i_abc = {}, faults |= kCurrentsNotFinite;
    if (!std::isfinite(r.v_dc)) good_.v_dc = 0, faults |= kBusNotFinite;
    if (!std::isfinite(r.theta_m)) good_.theta_m = 0, faults |= kPositionNotFinite;
    if (!std::isfinite(r.omega_m)) good_.omega_m = 0, faults |= kPositionNotFinite;
    raw_ = good_.i_abc;
    begun_ = true;
    if (measured) r = good_;
  } else if (!measured) {
    faults = kRowMissing;
    good_.i_abc = predicted_current(turned).phases();
    good_.theta_m += good_.omega_m * limits_.T_s;
  } else {
    faults = check_currents(r.i_abc, applied, turned) | check_position(r);
    if (!std::isfinite(r.v_dc)) r.v_dc = good_.v_dc, faults |= kBusNotFinite;
    good_ = r;
  }
  theta_e_ = applied.theta_e;
  omega_e_ = turned / limits_.T_s;
  u_before_ = applied.u;
  return faults;
}

}  // namespace twinrate
