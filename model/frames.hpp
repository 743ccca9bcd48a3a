// Reference frames: phases a, b, c; stationary alpha, beta; rotor d, q.
//
// Clarke, amplitude-invariant:
//
//   x_alpha = 2/3 (x_a - x_b/2 - x_c/2)                                                   Dilys (2)
//   x_beta  = (x_b - x_c)/sqrt3                                                           Dilys (2)
//
// Park; d lies on the magnet flux:
//
//   x_dq = R(-theta_e) x_alphabeta
//   R(a) = [cos a, -sin a; sin a, cos a]
//
// tests/model/frames_test.cpp fails when a sign is flipped.
#pragma once
#include <Eigen/Core>
#include <cmath>
#include <numbers>

#include "model/math.hpp"

namespace twinrate {

using Vec2 = Eigen::Vector2d;
using Vec3 = Eigen::Vector3d;
inline constexpr double kPi = std::numbers::pi;
inline constexpr double kTwoPi = 2 * std::numbers::pi;

inline Vec2 clarke(const Vec3& abc) {
  return {2.0 / 3.0 * (abc[0] - 0.5 * abc[1] - 0.5 * abc[2]),
          (abc[1] - abc[2]) * std::numbers::inv_sqrt3};
}

// The zero-sum phases of a stationary vector.
inline Vec3 inverse_clarke(const Vec2& alphabeta) {
  const double half_sqrt3_beta = 0.5 * std::numbers::sqrt3 * alphabeta[1];
  return {alphabeta[0], -0.5 * alphabeta[0] + half_sqrt3_beta,
          -0.5 * alphabeta[0] - half_sqrt3_beta};
}

inline Vec2 rotate(const Vec2& x, double angle_rad) {
  const auto [s, c] = math::sincos(angle_rad);
  return {c * x[0] - s * x[1], s * x[0] + c * x[1]};
}

inline Vec2 park(const Vec2& alphabeta, double theta_e) {
  return rotate(alphabeta, -theta_e);
}
inline Vec2 park(const Vec2& alphabeta, const math::SinCos& theta_e) {
  const auto [s, c] = theta_e;
  return {c * alphabeta[0] + s * alphabeta[1], c * alphabeta[1] - s * alphabeta[0]};
}
inline Vec2 inverse_park(const Vec2& dq, double theta_e) {
  return rotate(dq, theta_e);
}

// Into [0, 2 pi), Dilys (18).
inline double wrap_turn(double angle_rad) {
  // Spares the division where nothing is to be wrapped. + 0.0: -0 becomes 0, as below.
  if (angle_rad >= 0 && angle_rad < kTwoPi) return angle_rad + 0.0;
  const double wrapped = angle_rad - kTwoPi * std::floor(angle_rad / kTwoPi);
  return wrapped >= kTwoPi ? 0.0 : wrapped;  // NaN stays NaN
}
// Into (-pi, pi].
inline double wrap_pi(double angle_rad) {
  const double wrapped = wrap_turn(angle_rad);
  return wrapped > kPi ? wrapped - kTwoPi : wrapped;
}

}  // namespace twinrate
