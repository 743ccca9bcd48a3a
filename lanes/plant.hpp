// The machine in the stationary frame: exact for L_d = L_q, without rotations.
//
//   i'       = (u - R_s i)/L - b c',   c = [cos theta_e, sin theta_e],  b = psi_f/L
//   omega_e' = k_T i_q - B/J omega_e - n_p/J T_load,   i_q = i_beta cos - i_alpha sin
//   theta_e' = omega_e
//
// One step of two halves tau, time in units of tau: W = tau omega_e, A its rate, A_d that of A.
// Moments 0, 1, 2: begin, middle, end.
//
//   currents  i + b c is a flux whose only source besides u is a b c, a = tau R_s/L. So i is
//             e^(-a t) (i_0 + b c_0) - b c + (1 - e^(-a t))/a tau u/L + a b int e^(-a (t-s)) c ds.
//             In the integral c is replaced by the polynomial through c and its rate
//             W [-sin, cos] at 0 and 1 (for the end also c at 2); the exponential is exact:
//             mid_*, end_*
//   angle     to 1 by Taylor with W, A, A_d; to 2 by the cubic through A and A_d at 0 and 1; with
//             A_1 the cubic also gives the corrected W and angle at 1: late_*
//   speed     integral of the polynomial through A, A_d at 0 and 1 and A at 2
//
// with A = k_T i_q - B W - load and the rate of i_q in rotor axes,
// tau u_q/L - a i_q - W (i_d + b).
//
// sin and cos of the angle are states, rotated by the angle of half a step, and stay on the circle.
// tests/lanes/engine_test.cpp compares an interval with CVODE.
#pragma once
#include "lanes/constants.hpp"
#include "lanes/math.hpp"

namespace twinrate::lanes {

template <class T>
struct LanePlant {
  T i_alpha, i_beta, omega_e, theta_e;
  SinCos<T> at;  // of theta_e
};

// Rotates a unit vector by a small angle (error below 0.2 rad: 1e-13, below 0.5 rad: 3e-10).
template <class T>
SinCos<T> turn(const SinCos<T>& at, T angle) {
  const T z = angle * angle;
  const T s =
      angle + angle * z * (-1.0 / 6 + z * (1.0 / 120 + z * (-1.0 / 5040 + z * (1.0 / 362880))));
  const T c = 1.0 + z * (-0.5 + z * (1.0 / 24 + z * (-1.0 / 720 + z * (1.0 / 40320))));
  return {at.sin * c + at.cos * s, at.cos * c - at.sin * s};
}

// A and its rate at one moment.
template <class T>
struct Acceleration {
  T A, A_d;
};
// `u`: tau u/L.
template <class T>
Acceleration<T> acceleration(const LaneConstants<T>& c, T i_alpha, T i_beta, const SinCos<T>& at,
                             T W, const kernel::Stationary<T>& u, T load) {
  const T i_q = i_beta * at.cos - i_alpha * at.sin, i_d = i_alpha * at.cos + i_beta * at.sin;
  const T A = i_q * c.k_T - (W * c.B + load);
  const T i_q_d = u.beta * at.cos - u.alpha * at.sin - i_q * c.a - W * (i_d + c.b);
  return {A, i_q_d * c.k_T - A * c.B};
}

// One step. `u`: tau u/L, `load`: tau^2 n_p/J T_load. Returns the angle turned.
template <class T>
T plant_step(const LaneConstants<T>& c, LanePlant<T>& x, const kernel::Stationary<T>& u, T load) {
  const SinCos<T> at_0 = x.at;
  const T W_0 = x.omega_e * c.tau;
  const auto a_0 = acceleration(c, x.i_alpha, x.i_beta, at_0, W_0, u, load);
  const T to_mid = W_0 + a_0.A * 0.5 + a_0.A_d * (1.0 / 6), W_1 = W_0 + a_0.A + a_0.A_d * 0.5;
  const T sin_d0 = W_0 * at_0.cos, cos_d0 = -(W_0 * at_0.sin);
  const SinCos<T> at_1 = turn(at_0, to_mid);
  const T sin_d1 = W_1 * at_1.cos, cos_d1 = -(W_1 * at_1.sin);

  const T mid_alpha = x.i_alpha * c.mid_decay + u.alpha * c.mid_u + at_0.cos * c.mid_0 +
                      cos_d0 * c.mid_d0 + at_1.cos * c.mid_1 + cos_d1 * c.mid_d1;
  const T mid_beta = x.i_beta * c.mid_decay + u.beta * c.mid_u + at_0.sin * c.mid_0 +
                     sin_d0 * c.mid_d0 + at_1.sin * c.mid_1 + sin_d1 * c.mid_d1;
  const auto a_1 = acceleration(c, mid_alpha, mid_beta, at_1, W_1, u, load);
  const T turned = W_0 * 2.0 + a_0.A * 1.2 + a_1.A * 0.8 + (a_0.A_d + a_1.A_d) * (4.0 / 15);
  const SinCos<T> at_2 = turn(at_1, turned - to_mid);

  // W in the middle by the cubic, and the correction of the angle there.
  const T rate_1 = W_0 * c.end_d1 + a_0.A * c.late_0 + a_0.A_d * c.late_d0 + a_1.A * c.late_1 +
                   a_1.A_d * c.late_d1;
  x.i_alpha = x.i_alpha * c.end_decay + u.alpha * c.end_u + at_0.cos * c.end_0 + cos_d0 * c.end_d0 +
              at_1.cos * c.end_1 - at_1.sin * rate_1 + at_2.cos * c.end_2;
  x.i_beta = x.i_beta * c.end_decay + u.beta * c.end_u + at_0.sin * c.end_0 + sin_d0 * c.end_d0 +
             at_1.sin * c.end_1 + at_1.cos * rate_1 + at_2.sin * c.end_2;
  const T A_2 = (x.i_beta * at_2.cos - x.i_alpha * at_2.sin) * c.k_T - ((W_1 + a_1.A) * c.B + load);
  x.omega_e += (a_0.A * (2.0 / 3) + a_0.A_d * (2.0 / 15) + a_1.A * (16.0 / 15) +
                (a_1.A_d + A_2) * (4.0 / 15)) *
               c.inv_tau;
  x.at = at_2;
  return turned;
}

// One interval T_s under constant voltage and load.
template <class T>
void advance(const LaneConstants<T>& c, int steps, LanePlant<T>& plant,
             const kernel::Stationary<T>& u, T T_load) {
  const kernel::Stationary<T> forced{u.alpha * c.g, u.beta * c.g};
  const T load = T_load * c.load;
  T theta_e = plant.theta_e;
  for (int step = 0; step < steps; ++step) theta_e += plant_step(c, plant, forced, load);
  plant.theta_e = wrap_pi(theta_e);
}

}  // namespace twinrate::lanes
