// Common shapes of several effects.
//
//   smooth_sign(omega, scale) = tanh(omega/scale)    the sign of a speed, smooth for the
//                                                    integrator;
//                                                    within 0.5 % of +-1 above 3 scale
//   saturate(x) = max(-1, min(1, x))                 the sign of a current, linear near zero
//   current_sign(x, shape)                           the same with other shapes of the corner:
//                                                    tanh x, 2/pi atan(pi/2 x), x/sqrt(1 + x^2);
//                                                    all with slope 1 at zero and +-1 far out
//   sine(amplitude, phase): amplitude sin(angle + phase) = c_0 sin(angle) + c_1 cos(angle)
//   whole_orders(least, most): least, least + 1, .. most, as a grid
#pragma once
#include <cmath>
#include <span>
#include <vector>

#include "model/math.hpp"
#include "model/operating_point.hpp"

namespace twinrate {

inline constexpr double kSmoothSpeed = 0.02;  // rad/s, default scale of smooth_sign

inline double smooth_sign(double omega_m, double scale) {
  return math::tanh(omega_m / scale);
}

inline double saturate(double x) {
  return x > 1 ? 1 : x < -1 ? -1 : x;
}

enum class CurrentShape : int { kClamp = 0, kTanh = 1, kAtan = 2, kRoot = 3 };
inline constexpr const char* kCurrentShapeNames[] = {"clamp", "tanh", "atan", "root"};

inline double current_sign(double x, CurrentShape shape) {
  switch (shape) {
    case CurrentShape::kTanh:
      return math::tanh(x);
    case CurrentShape::kAtan:
      return 4 / kTwoPi * math::atan(kTwoPi / 4 * x);
    case CurrentShape::kRoot:
      return x / std::sqrt(1 + x * x);
    case CurrentShape::kClamp:
      break;
  }
  return saturate(x);
}

// An integral of current_sign.
inline double current_sign_integral(double x, CurrentShape shape) {
  switch (shape) {
    case CurrentShape::kTanh:
      return std::abs(x) + math::log1p(math::exp(-2 * std::abs(x)));
    case CurrentShape::kAtan: {
      const double y = kTwoPi / 4 * x;
      return 16 / (kTwoPi * kTwoPi) * (y * math::atan(y) - math::log1p(y * y) / 2);
    }
    case CurrentShape::kRoot:
      return std::sqrt(1 + x * x);
    case CurrentShape::kClamp:
      break;
  }
  return std::abs(x) < 1 ? x * x / 2 : std::abs(x) - 0.5;
}

// Mean of current_sign from x to y.
inline double mean_current_sign(double x, double y, CurrentShape shape) {
  // Below it the difference of the integrals is mostly rounding. The middle is off by at most an
  // eighth of it, at the corner of a clamp.
  constexpr double kMoment = 1e-6;
  if (std::abs(y - x) < kMoment) return current_sign((x + y) / 2, shape);
  return (current_sign_integral(y, shape) - current_sign_integral(x, shape)) / (y - x);
}

// The signs of the phase currents of a point in rotor axes; their mean if the current moves.
inline Vec2 current_signs(const OperatingPoint& point, double linear_current, CurrentShape shape) {
  const Vec3 from = point.i_abc();
  Vec3 signs;
  if (point.i_moves[0] == 0 && point.i_moves[1] == 0) {
    for (int phase = 0; phase < 3; ++phase)
      signs[phase] = current_sign(from[phase] / linear_current, shape);
    return point.phases_to_dq(signs);
  }
  const Vec3 to = from + inverse_clarke(point.i_moves);
  for (int phase = 0; phase < 3; ++phase) {
    const double x = from[phase], y = to[phase];
    const bool beyond = shape == CurrentShape::kClamp && x * y > 0 &&
                        std::abs(x) >= linear_current && std::abs(y) >= linear_current;
    signs[phase] = beyond ? std::copysign(1.0, x)
                          : mean_current_sign(x / linear_current, y / linear_current, shape);
  }
  return point.phases_to_dq(signs);
}

// c_0, c_1 of amplitude sin(angle + phase).
inline void sine_coefficients(double amplitude, double phase, std::span<double> values) {
  const auto [s, c] = math::sincos(phase);
  values[0] = amplitude * c;
  values[1] = amplitude * s;
}
// The way back: amplitude >= 0, phase in (-pi, pi].
inline void set_sine(std::span<const double> values, double& amplitude, double& phase) {
  amplitude = std::hypot(values[0], values[1]);
  phase = math::atan2(values[1], values[0]);
}

// One coefficient a phase.
inline void put_phases(const Vec3& x_abc, std::span<double> values) {
  for (int phase = 0; phase < 3; ++phase) values[static_cast<std::size_t>(phase)] = x_abc[phase];
}
inline Vec3 phases_of(std::span<const double> values) {
  return {values[0], values[1], values[2]};
}

inline std::vector<double> whole_orders(int least, int most) {
  std::vector<double> orders;
  for (int order = least; order <= most; ++order) orders.push_back(order);
  return orders;
}

}  // namespace twinrate
