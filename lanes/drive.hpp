// One tick of N drives in parallel, in the order of loop/closed_loop.hpp.
//
// Each member of LaneDrive is one row of lanes; a drive is a column, which lanes/runner.hpp inserts
// and extracts. Differences between lanes are blended, not branched. The gain policy is common to
// all lanes and a template parameter.
#pragma once
#include <numbers>
#include <utility>

#include "lanes/plant.hpp"

namespace twinrate::lanes {

// A gain and its linearisation angle.
template <class T>
struct PlannedGain {
  kernel::Gain42<T> K;
  kernel::UnitVector<T> at;
};

template <class T>
struct LaneDrive {
  // The point; times in ticks, steps a tick (infinite: no limit).
  T omega_m_target, slew_step, T_load_target, load_step;
  T n, k_full, k_settle, k_end;
  T noise_seed[3][2];  // hashed, as bits: two uniform streams a phase
  // Plant: state, load, voltage of the last interval, pending command.
  LanePlant<T> plant;
  T T_load;
  kernel::Stationary<T> u_applied, u_command;
  // Filter: state, sin and cos of its angle, covariance, gain in use, pending gain.
  kernel::SensorlessState<T> x;
  kernel::UnitVector<T> at;
  kernel::Symmetric4<T> P;
  PlannedGain<T> gain, next_gain;
  T until_snapshot;
  // Controller: slewed reference, integrals.
  T omega_m_ref, speed_integral, d_integral, q_integral;
  // Figures.
  T k, error_square_sum, error_max;
  T lost;  // 1: lost
};

// Blends structs of rows in place, row by row: a copy would go through memory.
template <class T, class Rows>
void blend_rows(typename T::Mask mask, const Rows& from, Rows& to) {
  const T* const source = reinterpret_cast<const T*>(&from);
  T* const target = reinterpret_cast<T*>(&to);
  [&]<std::size_t... row>(std::index_sequence<row...>) {
    ((target[row] = select<T>(mask, source[row], target[row])), ...);
  }
  (std::make_index_sequence<sizeof(Rows) / sizeof(T)>());
}

// model/profile.hpp's slew().
template <class T>
T slew_by(T from, T to, T step) {
  return from + max(min<T>(to - from, step), -step);
}

// model/sensors.hpp and Clarke: noise and ADC on each phase, in counts of the ADC.
template <class T>
kernel::Stationary<T> sample_currents(const LaneConstants<T>& c, const LaneSwitches& on,
                                      const LaneDrive<T>& d) {
  T i_a = d.plant.i_alpha * c.counts_an_A;
  const T half_alpha = i_a * -0.5, half_beta = d.plant.i_beta * c.half_sqrt3_counts_an_A;
  T i_b = half_alpha + half_beta, i_c = half_alpha - half_beta;
  if (on.noise) {
    const auto index = integer_of(d.k);
    i_a += normal(d.noise_seed[0][0], d.noise_seed[0][1], index) * c.noise_counts;
    i_b += normal(d.noise_seed[1][0], d.noise_seed[1][1], index) * c.noise_counts;
    i_c += normal(d.noise_seed[2][0], d.noise_seed[2][1], index) * c.noise_counts;
  }
  if (on.adc) i_a = round_to_even(i_a), i_b = round_to_even(i_b), i_c = round_to_even(i_c);
  return {(i_a * 2.0 - (i_b + i_c)) * c.third_A_a_count, (i_b - i_c) * c.inv_sqrt3_A_a_count};
}

// diag(R(a), I) K R(-a), a from the angle `from` to the angle `to`: estimator/gain_frame.hpp.
template <class T>
kernel::Gain42<T> turn_gain(const kernel::Gain42<T>& K, const kernel::UnitVector<T>& from,
                            const kernel::UnitVector<T>& to) {
  const T c = to.cos * from.cos + to.sin * from.sin, s = to.sin * from.cos - to.cos * from.sin;
  const T r00 = c * K.k00 - s * K.k10, r01 = c * K.k01 - s * K.k11;
  const T r10 = s * K.k00 + c * K.k10, r11 = s * K.k01 + c * K.k11;
  return {c * r00 - s * r01,     s * r00 + c * r01,      // rotation of the columns
          c * r10 - s * r11,     s * r10 + c * r11,      //
          c * K.k20 - s * K.k21, s * K.k20 + c * K.k21,  //
          c * K.k30 - s * K.k31, s * K.k30 + c * K.k31};
}

// diag(R(a), I) P diag(R(-a), I)
template <class T>
kernel::Symmetric4<T> turn_covariance(const kernel::Symmetric4<T>& P, const SinCos<T>& a) {
  const T c = a.cos, s = a.sin;
  const T r00 = c * P.m00 - s * P.m01, r01 = c * P.m01 - s * P.m11;
  const T r10 = s * P.m00 + c * P.m01, r11 = s * P.m01 + c * P.m11;
  return {c * r00 - s * r01,
          s * r00 + c * r01,
          c * P.m02 - s * P.m12,
          c * P.m03 - s * P.m13,
          s * r10 + c * r11,
          s * P.m02 + c * P.m12,
          s * P.m03 + c * P.m13,
          P.m22,
          P.m23,
          P.m33};
}

// sin and cos of the filter's angle plus `angle`: by rotation if `angle` is small, which is the
// usual case.
template <class T>
SinCos<T> ahead(const LaneDrive<T>& d, T angle) {
  SinCos<T> at = turn(SinCos<T>{d.at.sin, d.at.cos}, angle);
  const auto far = abs(angle) > T(0.5);
  if (any<T>(far)) [[unlikely]]
    blend_rows<T>(far, sincos<T>(d.x.theta_e + angle), at);
  return at;
}

template <bool rk4, class T>
kernel::SensorlessState<T> predict(const LaneConstants<T>& c, const LaneDrive<T>& d) {
  if constexpr (!rk4) {
    return predict_euler(c.filter, d.x, d.at, d.u_applied);
  } else {
    const T turned = d.x.omega_e * c.T_s;
    const auto mid = ahead<T>(d, turned * 0.5), end = ahead(d, turned);
    return predict_rk4(c.filter, d.x, d.at, {mid.sin, mid.cos}, {end.sin, end.cos}, d.u_applied);
  }
}

// FastLoop::tick: initialises with the first sample, predicts and corrects with every other one.
template <Policy policy, bool rk4, class T>
void fast_step(const LaneConstants<T>& c, LaneDrive<T>& d, const kernel::Stationary<T>& i_meas,
               bool any_snapshot) {
  kernel::Gain42<T> K = d.gain.K;
  if constexpr (policy == Policy::kRotate || policy == Policy::kRotorFrame)
    K = turn_gain(K, d.gain.at, d.at);
  const auto x_prior = predict<rk4>(c, d);
  auto x = correct(x_prior, K, innovation(x_prior, i_meas));
  if (any_snapshot) {  // the first tick is a snapshot
    const kernel::SensorlessState<T> first{i_meas.alpha, i_meas.beta, d.x.omega_e, d.x.theta_e};
    blend_rows<T>(d.k == T(0), first, x);
  }
  const auto at = sincos(x.theta_e);
  x.theta_e = wrap_pi(x.theta_e);
  d.x = x;
  d.at = {at.sin, at.cos};
}

// BackgroundLoop::step at the snapshot d.x, in the lanes that take one.
template <Policy policy, class T>
void background_step(const LaneConstants<T>& c, const LaneSwitches& on, LaneDrive<T>& d,
                     typename T::Mask snapshot, T ticks_a_gain) {
  kernel::UnitVector<T> at = d.at;
  if constexpr (policy == Policy::kExtrapolate) {
    const auto later = ahead<T>(d, (ticks_a_gain - T(1)) * 1.5 * c.T_s * d.x.omega_e);
    at = {later.sin, later.cos};
  }
  if constexpr (policy == Policy::kRotorFrame) {
    const T turned = (ticks_a_gain - T(1)) * c.T_s * d.x.omega_e;
    blend_rows<T>(snapshot & (d.k > T(0)), turn_covariance(d.P, sincos(turned)), d.P);
  }
  const auto P_prior = propagate(c.filter, jacobian(c.filter, d.x.omega_e, at), d.P, c.Q);
  if (on.covariance == CovarianceForm::kSequential) {
    const auto both = kernel::sequential(P_prior, c.R);
    blend_rows<T>(snapshot, both.K, d.next_gain.K);
    blend_rows<T>(snapshot, both.P, d.P);
  } else {
    const auto K = kernel::gain(P_prior, c.R);
    blend_rows<T>(snapshot, K, d.next_gain.K);
    if (on.covariance == CovarianceForm::kPaper)
      blend_rows<T>(snapshot, posterior(P_prior, K, c.R), d.P);
    else
      blend_rows<T>(snapshot, posterior_joseph(P_prior, K, c.R), d.P);
  }
  blend_rows<T>(snapshot, at, d.next_gain.at);
  if constexpr (policy == Policy::kImmediate) blend_rows<T>(snapshot, d.next_gain, d.gain);
}

// Limits the voltage to the circle and corrects the integrals (anti-windup). In most ticks no lane
// is limited.
template <class T>
void limit_voltage(const LaneConstants<T>& c, LaneDrive<T>& d, T& u_d, T& u_q) {
  const T square = u_d * u_d + u_q * u_q;
  const auto beyond = square > c.u_max_square;
  if (!any<T>(beyond)) [[likely]]
    return;
  const T share = select(beyond, c.u_max / sqrt(square), T(1));
  const T u_d_limited = u_d * share, u_q_limited = u_q * share;
  d.d_integral += (u_d_limited - u_d) * c.k_awu;
  d.q_integral += (u_q_limited - u_q) * c.k_awu;
  u_d = u_d_limited, u_q = u_q_limited;
}

// controller/foc.hpp in closed loop: speed PI, current PI with decoupling, voltage circle, advance.
template <class T>
kernel::Stationary<T> control(const LaneConstants<T>& c, LaneDrive<T>& d,
                              const kernel::Stationary<T>& i_meas) {
  const T i_d = d.at.cos * i_meas.alpha + d.at.sin * i_meas.beta;
  const T i_q = d.at.cos * i_meas.beta - d.at.sin * i_meas.alpha;
  const T omega_m = d.x.omega_e * c.inv_n_p;
  d.omega_m_ref = slew_by(d.omega_m_ref, d.omega_m_target, d.slew_step);

  const T speed_error = d.omega_m_ref - omega_m;
  const T i_q_wanted = speed_error * c.K_p_speed + d.speed_integral;
  const T i_q_ref = max(min(i_q_wanted, c.i_q_max), -c.i_q_max);
  d.speed_integral += speed_error * c.K_i_speed;
  d.speed_integral += (i_q_ref - i_q_wanted) * c.k_awu_speed;

  const T d_error = c.i_d_ref - i_d, q_error = i_q_ref - i_q;
  const T omega_L = d.x.omega_e * c.L;
  T u_d = d_error * c.K_p + d.d_integral - omega_L * i_q;
  T u_q = q_error * c.K_p + d.q_integral + (omega_L * i_d + d.x.omega_e * c.psi_f);
  d.d_integral += d_error * c.K_i;
  d.q_integral += q_error * c.K_i;
  limit_voltage(c, d, u_d, u_q);
  const auto acts = ahead<T>(d, d.x.omega_e * c.advance_s);
  return {acts.cos * u_d - acts.sin * u_q, acts.sin * u_d + acts.cos * u_q};
}

// docs/conventions.md: angle error and lock, over [k_settle, k_end). Returns the mask of ended
// lanes; a lane ends when it loses synchronism. The angle error of a diverged or not finite state
// is outside [-pi, pi] or not a number.
template <class T>
typename T::Mask update_figures(LaneDrive<T>& d) {
  const T error = wrap_pi<T>(d.x.theta_e - d.plant.theta_e), magnitude = abs(error);
  const auto in_window = d.k >= d.k_settle;
  d.error_square_sum = select<T>(in_window, d.error_square_sum + error * error, d.error_square_sum);
  d.error_max = select(in_window, max(magnitude, d.error_max), d.error_max);
  const T limit = select(in_window, T(0.5 * std::numbers::pi), T(4));
  const auto lost = !(magnitude <= limit);  // also true if the error is not a number
  d.lost = select(lost, T(1), T(0));
  d.k += T(1);
  return (d.k >= d.k_end) | lost;
}

// k -> k + 1. Returns the mask of ended lanes.
template <Policy policy, bool rk4, class T>
[[gnu::flatten]] typename T::Mask tick(const LaneConstants<T>& c, const LaneSwitches& on,
                                       LaneDrive<T>& d) {
  const auto i_meas = sample_currents(c, on, d);
  const auto snapshot = d.until_snapshot == T(0);
  const bool any_snapshot = any<T>(snapshot);
  if (policy != Policy::kImmediate && any_snapshot) blend_rows<T>(snapshot, d.next_gain, d.gain);
  fast_step<policy, rk4>(c, d, i_meas, any_snapshot);
  if (any_snapshot) {
    const T ticks_a_gain = select(d.k < d.k_full, T(1), d.n);
    background_step<policy>(c, on, d, snapshot, ticks_a_gain);
    d.until_snapshot = select(snapshot, ticks_a_gain, d.until_snapshot);
  }
  d.until_snapshot -= T(1);

  const auto u_new = control(c, d, i_meas);
  d.T_load = slew_by(d.T_load, d.T_load_target, d.load_step);
  LanePlant<T> next = d.plant;
  advance(c, on.plant_steps, next, d.u_command, d.T_load);
  const auto ended = update_figures(d);
  d.plant = next;
  d.u_applied = d.u_command;
  d.u_command = u_new;
  return ended;
}

}  // namespace twinrate::lanes
