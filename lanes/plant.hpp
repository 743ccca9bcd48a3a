// The machine in the stationary frame: exact for L_d = L_q, and no frame to turn.
//
//   i_alpha' = (u_alpha - R_s i_alpha)/L + psi_f/L omega_e sin theta_e
//   i_beta'  = (u_beta  - R_s i_beta)/L  - psi_f/L omega_e cos theta_e
//   omega_e' = 3/2 n_p^2 psi_f/J (i_beta cos theta_e - i_alpha sin theta_e) - B/J omega_e - n_p/J
//   T_load theta_e' = omega_e
//
// Runge-Kutta 4 with two helps against what limits the step. The decay of the currents is solved
// exactly (integrating factor exp(R_s/L t), Lawson 1967; w_0, w_m, w_1 integrate a parabola through
// the stages under it); and sin and cos of the angle are states
// that are turned by the angle of half a step, so a stage has them exactly and they stay on the
// circle. tests/lanes/engine_test.cpp holds an interval against CVODE.
#pragma once
#include "lanes/constants.hpp"
#include "lanes/math.hpp"

namespace twinrate::lanes {

template <class T>
struct LanePlant {
  T i_alpha, i_beta, omega_e, theta_e;
  SinCos<T> at;  // of theta_e
};

// h times the rates, those of the currents without their decay.
template <class T>
struct PlantRate {
  T i_alpha, i_beta, omega_e;
};

template <class T>
PlantRate<T> plant_rate(const LaneConstants<T>& c, T i_alpha, T i_beta, T omega_e,
                        const SinCos<T>& at, const PlantRate<T>& forced) {
  const T emf = omega_e * c.b;
  return {forced.i_alpha + emf * at.sin, forced.i_beta - emf * at.cos,
          forced.omega_e + (i_beta * at.cos - i_alpha * at.sin) * c.k_T - omega_e * c.B};
}

// The unit vector turned by a small angle (below about 0.3 rad: 1e-11).
template <class T>
SinCos<T> turn(const SinCos<T>& at, T angle) {
  const T z = angle * angle;
  const T s = angle * (1.0 + z * (-1.0 / 6 + z * (1.0 / 120 - z * (1.0 / 5040))));
  const T c = 1.0 + z * (-0.5 + z * (1.0 / 24 - z * (1.0 / 720)));
  return {at.sin * c + at.cos * s, at.cos * c - at.sin * s};
}

// One step h. Returns the angle turned.
template <class T>
T plant_step(const LaneConstants<T>& c, LanePlant<T>& x, const PlantRate<T>& forced) {
  const auto k1 = plant_rate(c, x.i_alpha, x.i_beta, x.omega_e, x.at, forced);
  const T to_mid = (x.omega_e + k1.omega_e * 0.25) * c.half_h;
  const SinCos<T> mid = turn(x.at, to_mid);
  const T half_alpha = x.i_alpha * c.decay_half, half_beta = x.i_beta * c.decay_half;
  const auto k2 = plant_rate(c, half_alpha + k1.i_alpha * c.half_decay_half,
                             half_beta + k1.i_beta * c.half_decay_half,
                             x.omega_e + k1.omega_e * 0.5, mid, forced);
  const auto k3 = plant_rate(c, half_alpha + k2.i_alpha * 0.5, half_beta + k2.i_beta * 0.5,
                             x.omega_e + k2.omega_e * 0.5, mid, forced);
  const T turned = (x.omega_e + (k1.omega_e + k2.omega_e + k3.omega_e) * (1.0 / 6)) * c.h;
  const SinCos<T> end = turn(mid, turned - to_mid);
  const T full_alpha = x.i_alpha * c.decay_full, full_beta = x.i_beta * c.decay_full;
  const auto k4 =
      plant_rate(c, full_alpha + k3.i_alpha * c.decay_half, full_beta + k3.i_beta * c.decay_half,
                 x.omega_e + k3.omega_e, end, forced);
  x.i_alpha =
      full_alpha + k1.i_alpha * c.w_0 + (k2.i_alpha + k3.i_alpha) * c.w_m + k4.i_alpha * c.w_1;
  x.i_beta = full_beta + k1.i_beta * c.w_0 + (k2.i_beta + k3.i_beta) * c.w_m + k4.i_beta * c.w_1;
  x.omega_e += (k1.omega_e + k4.omega_e) * (1.0 / 6) + (k2.omega_e + k3.omega_e) * (1.0 / 3);
  x.at = end;
  return turned;
}

// One interval T_s under constant voltage and load.
template <class T>
void advance(const LaneConstants<T>& c, int steps, LanePlant<T>& plant,
             const kernel::Stationary<T>& u, T T_load) {
  const PlantRate<T> forced{u.alpha * c.g, u.beta * c.g, -(T_load * c.load)};
  T turned = 0;
  for (int step = 0; step < steps; ++step) turned += plant_step(c, plant, forced);
  plant.theta_e = wrap_turn(plant.theta_e + turned);
}

}  // namespace twinrate::lanes
