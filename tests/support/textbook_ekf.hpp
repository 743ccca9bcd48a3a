// The two filters in textbook form with Eigen matrices: oracle of the hand-written kernels, and
// reference of the benchmarks. NX, NY fixed, or Eigen::Dynamic for matrices of any size.
//
//   x^- = f(x, u);  P^- = F P F' + Q;  K = P^- H' (H P^- H' + R)^-1
//   x = x^- + K (y - H x^-);  P = (I - K H) P^- (I - K H)' + K R K'
//   simple_form:              P = (I - K H) P^-
#pragma once
#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>

#include "model/machine.hpp"

namespace twinrate::test {

template <int NX, int NY>
struct TextbookEkf {
  using State = Eigen::Matrix<double, NX, 1>;
  using Output = Eigen::Matrix<double, NY, 1>;
  using Covariance = Eigen::Matrix<double, NX, NX>;
  using GainMatrix = Eigen::Matrix<double, NX, NY>;
  using OutputMatrix = Eigen::Matrix<double, NY, NX>;
  using OutputCovariance = Eigen::Matrix<double, NY, NY>;

  State x;
  Covariance P, Q;
  OutputCovariance R;
  OutputMatrix H;
  GainMatrix K;
  bool simple_form = false;

  TextbookEkf(int n_x, int n_y)
      : x(State::Zero(n_x)),
        P(Covariance::Identity(n_x, n_x)),
        Q(Covariance::Identity(n_x, n_x)),
        R(OutputCovariance::Identity(n_y, n_y)),
        H(OutputMatrix::Identity(n_y, n_x)),
        K(GainMatrix::Zero(n_x, n_y)) {}

  void background(const Covariance& F) {
    const Covariance P_prior = F * P * F.transpose() + Q;
    const OutputCovariance S = H * P_prior * H.transpose() + R;
    K = P_prior * H.transpose() * S.inverse();
    const Covariance I_KH = Covariance::Identity(x.size(), x.size()) - K * H;
    if (simple_form)
      P = I_KH * P_prior;
    else
      P = I_KH * P_prior * I_KH.transpose() + K * R * K.transpose();
  }
  void correct(const State& x_prior, const Output& y) { x = x_prior + K * (y - H * x_prior); }
};

// x = [i_alpha, i_beta, omega_e, theta_e] (Dilys 2021), explicit Euler.
template <int NX, int NY>
struct TextbookSensorless : TextbookEkf<NX, NY> {
  using Base = TextbookEkf<NX, NY>;
  MachineParameters m;
  double T_s;

  TextbookSensorless(const MachineParameters& machine, double period)
      : Base(4, 2), m(machine), T_s(period) {}

  typename Base::State f(const typename Base::State& s, double u_alpha, double u_beta) const {
    typename Base::State rate(4);
    rate << (u_alpha - m.R_s * s[0] + m.psi_f * s[2] * std::sin(s[3])) / m.L_d,
        (u_beta - m.R_s * s[1] - m.psi_f * s[2] * std::cos(s[3])) / m.L_d, 0, s[2];
    return rate;
  }
  typename Base::Covariance jacobian(const typename Base::State& s) const {
    const double sine = std::sin(s[3]), cosine = std::cos(s[3]);
    typename Base::Covariance dfdx(4, 4);
    dfdx << -m.R_s / m.L_d, 0, m.psi_f * sine / m.L_d, m.psi_f * s[2] * cosine / m.L_d,  //
        0, -m.R_s / m.L_d, -m.psi_f * cosine / m.L_d, m.psi_f * s[2] * sine / m.L_d,     //
        0, 0, 0, 0,                                                                      //
        0, 0, 1, 0;
    return Base::Covariance::Identity(4, 4) + T_s * dfdx;
  }
  // The whole filter, as with n = 1: linearise at the old state, predict, correct.
  void step(double u_alpha, double u_beta, const typename Base::Output& y) {
    const typename Base::Covariance F = jacobian(this->x);
    const typename Base::State x_prior = this->x + T_s * f(this->x, u_alpha, u_beta);
    this->background(F);
    this->correct(x_prior, y);
  }
};

// x = [i_d, i_q, omega_m, T_o] (Niewiara 2020), explicit Euler, without (25).
template <int NX, int NY>
struct TextbookDq : TextbookEkf<NX, NY> {
  using Base = TextbookEkf<NX, NY>;
  MachineParameters m;
  double T_s;

  TextbookDq(const MachineParameters& machine, double period)
      : Base(4, 3), m(machine), T_s(period) {}

  typename Base::State f(const typename Base::State& s, double u_d, double u_q) const {
    const double omega_e = m.n_p * s[2];
    typename Base::State rate(4);
    rate << (u_d - m.R_s * s[0] + omega_e * m.L_q * s[1]) / m.L_d,
        (u_q - m.R_s * s[1] - omega_e * (m.L_d * s[0] + m.psi_f)) / m.L_q,
        (m.torque(s[0], s[1]) - s[3]) / m.J, 0;
    return rate;
  }
  typename Base::Covariance jacobian(const typename Base::State& s) const {
    const double omega_e = m.n_p * s[2], dL = m.L_d - m.L_q, k_T = 1.5 * m.n_p / m.J;
    typename Base::Covariance dfdx(4, 4);
    dfdx << -m.R_s / m.L_d, omega_e * m.L_q / m.L_d, m.n_p * m.L_q * s[1] / m.L_d, 0,            //
        -omega_e * m.L_d / m.L_q, -m.R_s / m.L_q, -m.n_p * (m.L_d * s[0] + m.psi_f) / m.L_q, 0,  //
        k_T * dL * s[1], k_T * (m.psi_f + dL * s[0]), 0, -1 / m.J,                               //
        0, 0, 0, 0;
    return Base::Covariance::Identity(4, 4) + T_s * dfdx;
  }
  void step(double u_d, double u_q, const typename Base::Output& y) {
    const typename Base::Covariance F = jacobian(this->x);
    const typename Base::State x_prior = this->x + T_s * f(this->x, u_d, u_q);
    this->background(F);
    this->correct(x_prior, y);
  }
};

}  // namespace twinrate::test
