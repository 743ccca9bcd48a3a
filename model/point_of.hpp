// The operating point of the drive in a given frame: the only place that makes an OperatingPoint
// from a sample or a state.
//
// The frame determines the angle: that of the sensor, of an estimate, or the true one. Stator
// quantities are turned into rotor axes by its theta_e.
#pragma once
#include "model/effects/effect.hpp"
#include "model/signals.hpp"

namespace twinrate {

struct RotorFrame {
  double omega_m = 0, theta_m = 0;
  double theta_e = 0;
  Vec2 d_axis = Vec2::Zero();  // as in OperatingPoint
};

// theta_e = n_p theta_m
inline RotorFrame frame_at(double theta_m, double omega_m, int n_p) {
  return {.omega_m = omega_m, .theta_m = theta_m, .theta_e = n_p * theta_m};
}

// Currents `i_dq` are in the axes of `frame` already; t is drive time in s.
inline OperatingPoint point_of(double t, const RotorFrame& frame, const Vec2& i_dq = Vec2::Zero()) {
  return {.t = t,
          .i_dq = i_dq,
          .omega_m = frame.omega_m,
          .theta_m = frame.theta_m,
          .theta_e = frame.theta_e,
          .d_axis = frame.d_axis};
}

// The sample's own currents, voltage and bus voltage.
inline OperatingPoint point_of(const Measurement& m, const RotorFrame& frame) {
  OperatingPoint p = point_of(1e-9 * static_cast<double>(m.t_ns), frame);
  p.i_dq = p.rotor_axes(clarke(m.i_abc));
  p.u_dq = p.rotor_axes(m.u_alphabeta);
  p.v_dc = m.v_dc;
  return p;
}

}  // namespace twinrate
