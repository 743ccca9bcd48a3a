#include "estimator/scaled_tuning.hpp"

#include <algorithm>
#include <initializer_list>

namespace twinrate {
namespace {

double sq(double x) {
  return x * x;
}

template <std::size_t N>
void set(double (&diagonal)[N], std::initializer_list<double> values) {
  std::copy(values.begin(), values.end(), diagonal);
}

// Dilys 2021, (22): i 1.5 A, step 5.04 rad/s.
constexpr double kDilysCurrent = 0.667, kDilysSpeed = 4.44;
// Kim: i 2.447 A, omega_e 418.9 rad/s, e 119.4 V, step 4.84 rad/s.
constexpr double kKimCurrent = 4.09e-3, kKimNoise = 0.0129, kKimEmf = 5.92e-3, kKimSpeed = 0.413;
// Niewiara 2020, (29), (30), Table 1: i 7.07 A, omega_m 104.7 rad/s, J 8.8e-3 kgm2, T_s 100 us. The
// gains of the load torque go with J, per second squared: L/J, and sqrt(Q_T/R_omega)/(J T_s).
constexpr double kNiewiaraSpeedPole = 1000, kNiewiaraLoad = 2.93e4, kNiewiaraIntegral = 7.95e4;

// Q, R of the first four states and three outputs. `n_p` from T step = n_p T^2 T_s/J.
template <class Parameters>
void scale_disturbance(Parameters& p, const PerUnit& base, double J, double T_s) {
  const double n_p = base.step * J / (base.T * T_s), omega_m = base.omega_e / n_p;
  const double R_omega = sq(0.117 * omega_m);
  set(p.R_diag, {sq(0.447 * base.i), sq(0.447 * base.i), R_omega});
  set(p.Q_diag,
      {sq(0.141 * base.i), sq(0.2 * base.i), R_omega * sq(std::min(1.0, kNiewiaraSpeedPole * T_s)),
       R_omega * sq(kNiewiaraLoad * J * T_s)});
  set(p.P0_diag,
      {sq(0.141 * base.i), sq(0.141 * base.i), sq(0.00955 * omega_m), sq(0.123 * base.T)});
}

}  // namespace

void scale(EkfSensorlessParameters& p, const PerUnit& base, double, double) {
  const double current = sq(kDilysCurrent * base.i);
  set(p.Q_diag, {current, current, sq(kDilysSpeed * base.step), 0.1});
  set(p.R_diag, {current, current});
  set(p.P0_diag, {current, current, sq(6e-4 * base.omega_e), 1});
}

void scale(EkfDisturbanceParameters& p, const PerUnit& base, double J, double T_s) {
  scale_disturbance(p, base, J, T_s);
  p.L = -kNiewiaraIntegral * J;
}

void scale(EkfHarmonicParameters& p, const PerUnit& base, double J, double T_s) {
  scale_disturbance(p, base, J, T_s);
  p.Q_order = 0.01 * p.Q_diag[3];
  p.P0_order = p.P0_diag[3];
}

void scale(BackEmfParameters& p, const PerUnit& base, double, double) {
  const double current = sq(18.3 * base.i), emf = sq(2.37 * base.e);
  set(p.Q_diag, {current, current, emf, emf});  // equal: the vector turns
  set(p.R_diag, {sq(0.289 * base.i), sq(0.289 * base.i)});
  set(p.P0_diag, {sq(0.129 * base.i), sq(0.129 * base.i), sq(0.118 * base.e), sq(0.118 * base.e)});
}

void scale(ActiveFluxParameters& p, const PerUnit& base, double, double) {
  const double current = sq(kKimCurrent * base.i), emf = sq(kKimEmf * base.e);
  set(p.Q_diag, {current, current, emf, emf});
  set(p.R_diag, {sq(kKimNoise * base.i), sq(kKimNoise * base.i)});
  set(p.P0_diag,
      {sq(0.409 * base.i), sq(0.409 * base.i), sq(8.4e-3 * base.e), sq(8.4e-3 * base.e)});
}

void scale(EemfParameters& p, const PerUnit& base, double, double) {
  const double current = sq(kKimCurrent * base.i), emf = sq(kKimEmf * base.e);
  set(p.Q_diag, {current, current, emf, emf, sq(kKimSpeed * base.step)});
  set(p.R_diag, {sq(kKimNoise * base.i), sq(kKimNoise * base.i)});
  set(p.P0_diag, {sq(0.0409 * base.i), sq(0.0409 * base.i), sq(0.084 * base.e), sq(0.084 * base.e),
                  sq(0.0239 * base.omega_e)});
}

void scale(DqEkfParameters& p, const PerUnit& base, double, double) {
  const double current = sq(kKimCurrent * base.i);
  set(p.Q_diag, {current, current, sq(kKimSpeed * base.step), 1e-6});
  p.r = sq(kKimNoise * base.i);
  set(p.P0_diag, {sq(0.0409 * base.i), sq(0.0409 * base.i), sq(0.0239 * base.omega_e), 3});
}

// Noise of the currents as for dq_ekf. The load changes by a twentieth of the rated torque in a
// tick and takes up deviations of the speed. The variance of the angle makes its correction strong
// against that of the speed: EkfJoint::load_speed_min(). Its initial variance is that of 10 deg:
// with a larger one the first corrections pass a rotor that is 75 deg away, and the load pulls it
// on (1 rad^2 loses 1 of 24 starts without saliency at 0.6 of rated torque, 0.03 none:
// build/bench/direct_starts).
void scale(EkfJointParameters& p, const PerUnit& base, double, double) {
  const double current = sq(kKimCurrent * base.i);
  set(p.Q_diag, {current, current, sq(0.05 * base.step), 1e-4, sq(0.05 * base.T)});
  set(p.R_diag, {sq(kKimNoise * base.i), sq(kKimNoise * base.i)});
  set(p.P0_diag, {sq(0.0409 * base.i), sq(0.0409 * base.i), sq(0.0239 * base.omega_e), 0.03,
                  sq(0.123 * base.T)});
  p.Q_order = 0.01 * p.Q_diag[4];
  p.P0_order = p.P0_diag[4];
}

}  // namespace twinrate
