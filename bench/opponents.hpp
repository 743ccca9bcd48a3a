// Three implementations of a filter step on the same samples: hand-written, textbook form with
// Eigen matrices of fixed size and of dynamic size. Each with P = (I - K H) P^- ("paper") and in
// Joseph's form, so that like is compared with like.
#pragma once
#include <cmath>
#include <vector>

#include "core/covariance_form.hpp"
#include "estimator/kernels/ekf_dq_kernel.hpp"
#include "estimator/kernels/ekf_sensorless_kernel.hpp"
#include "estimator/kernels/ud_filter.hpp"
#include "model/frames.hpp"
#include "model/math.hpp"
#include "model/random.hpp"
#include "tests/support/textbook_ekf.hpp"

namespace twinrate::bench {

inline MachineParameters dilys() {
  return {.R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .B = 1e-5, .n_p = 4};
}
constexpr double kTs = 2e-4;

struct Sample {
  double u_alpha, u_beta, i_alpha, i_beta;
};

// A machine at 400 rad/s with noise: 512 samples, used cyclically.
inline const std::vector<Sample>& samples() {
  static const std::vector<Sample> all = [] {
    std::vector<Sample> s;
    for (std::uint64_t k = 0; k < 512; ++k) {
      const double theta_e = kTwoPi * 13 * static_cast<double>(k) / 512;  // 399 rad/s
      s.push_back({-3 * std::sin(theta_e), 3 * std::cos(theta_e),
                   -std::sin(theta_e) + 0.02 * normal(1, 0, k),
                   std::cos(theta_e) + 0.02 * normal(1, 1, k)});
    }
    return s;
  }();
  return all;
}

// The hand-written filter with n = 1: prediction, gain, covariance, correction.
template <class T, CovarianceForm kForm = CovarianceForm::kPaper>
struct KernelFilter {
  kernel::SensorlessConstants<T> c = kernel::sensorless_euler<T>(
      static_cast<T>(1.2), static_cast<T>(5e-4), static_cast<T>(0.007), static_cast<T>(kTs));
  T Q[4] = {1, 1, 500, static_cast<T>(0.1)}, R[2] = {1, 1};
  kernel::SensorlessState<T> x{0, 0, 400, 0};
  kernel::Symmetric4<T> P{1, 0, 0, 0, 1, 0, 0, 1, 0, 1};
  kernel::Gain42<T> K{};

  void background(const kernel::UnitVector<T>& at) {
    const auto P_prior = propagate(c, jacobian(c, x.omega_e, at), P, Q);
    K = kernel::gain(P_prior, R);
    if constexpr (kForm == CovarianceForm::kPaper)
      P = posterior(P_prior, K, R);
    else
      P = posterior_joseph(P_prior, K, R);
  }
  void fast(const kernel::UnitVector<T>& at, const Sample& s) {
    const auto x_prior = predict_euler(
        c, x, at, kernel::Stationary<T>{static_cast<T>(s.u_alpha), static_cast<T>(s.u_beta)});
    x = correct(x_prior, K,
                innovation(x_prior, {static_cast<T>(s.i_alpha), static_cast<T>(s.i_beta)}));
  }
  void step(const Sample& s) {
    const auto [s_theta, c_theta] = math::sincos(static_cast<double>(x.theta_e));
    const kernel::UnitVector<T> at{static_cast<T>(s_theta), static_cast<T>(c_theta)};
    background(at);
    fast(at, s);
  }
};

template <int NX, int NY, CovarianceForm kForm = CovarianceForm::kJoseph>
struct EigenFilter : test::TextbookSensorless<NX, NY> {
  EigenFilter() : test::TextbookSensorless<NX, NY>(dilys(), kTs) {
    this->simple_form = kForm == CovarianceForm::kPaper;
    this->x[2] = 400;
    this->Q.diagonal() << 1, 1, 500, 0.1;
  }
  // Sine and cosine once, as the hand-written one; the textbook's own step takes them twice.
  void step(const Sample& s) {
    using Ekf = test::TextbookEkf<NX, NY>;
    const MachineParameters& drive = this->m;
    const double h = this->T_s, omega_e = this->x[2];
    const double sine = std::sin(this->x[3]), cosine = std::cos(this->x[3]);
    const double d = 1 - h * drive.R_s / drive.L_d, b = h * drive.psi_f / drive.L_d;
    typename Ekf::State x_prior(4);
    x_prior << d * this->x[0] + h / drive.L_d * s.u_alpha + b * omega_e * sine,
        d * this->x[1] + h / drive.L_d * s.u_beta - b * omega_e * cosine, omega_e,
        this->x[3] + h * omega_e;
    typename Ekf::Covariance F(4, 4);
    F << d, 0, b * sine, b * omega_e * cosine,  //
        0, d, -b * cosine, b * omega_e * sine,  //
        0, 0, 1, 0,                             //
        0, 0, h, 1;
    this->background(F);
    typename Ekf::Output y(2);
    y << s.i_alpha, s.i_beta;
    this->correct(x_prior, y);
  }
};

}  // namespace twinrate::bench
