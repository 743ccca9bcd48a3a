// With n = 1 the two-rate filter is the ordinary extended Kalman filter. Oracle: the textbook form
// with matrices of any size and the equations of docs/theory/two-rate-ekf.md.
#include <gtest/gtest.h>

#include "estimator/ekf_disturbance.hpp"
#include "estimator/ekf_sensorless.hpp"
#include "estimator/two_rate.hpp"
#include "model/linear_algebra.hpp"
#include "model/random.hpp"

namespace twinrate::textbook_ekf_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kTs = 2e-4;

// x' = f(x, u), y = [I 0] x; explicit Euler.
struct TextbookEkf {
  VectorXd x;
  MatrixXd P, Q, R;

  void step(const VectorXd& f, const MatrixXd& dfdx, const VectorXd& y) {
    const Eigen::Index nx = x.size(), ny = y.size();
    const MatrixXd H = MatrixXd::Identity(ny, nx), F = MatrixXd::Identity(nx, nx) + kTs * dfdx;
    const VectorXd x_prior = x + kTs * f;
    const MatrixXd P_prior = F * P * F.transpose() + Q;
    const MatrixXd S = H * P_prior * H.transpose() + R;
    const MatrixXd K = linear::solve_symmetric(S, H * P_prior).transpose();
    x = x_prior + K * (y - H * x_prior);
    const MatrixXd I_KH = MatrixXd::Identity(nx, nx) - K * H;
    P = I_KH * P_prior * I_KH.transpose() + K * R * K.transpose();
  }
};

MatrixXd diagonal(std::initializer_list<double> values) {
  VectorXd d(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), d.data());
  return d.asDiagonal();
}

TEST(TwoRateAtNOne, EqualsTheTextbookEkfOfTheSensorlessModel) {
  const MachineParameters m{
      .R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .B = 1e-5, .n_p = 4};
  const auto filter = std::make_shared<EkfSensorless>(
      m, EkfSensorlessParameters{}, Prediction::kEuler, CovarianceForm::kJoseph, kTs);
  FastLoop fast(filter, GainPolicy::kPaper, 1);
  BackgroundLoop background(filter, GainPolicy::kPaper, 1);
  TextbookEkf oracle{VectorXd::Zero(4), MatrixXd::Identity(4, 4), diagonal({1, 1, 500, 0.1}),
                     diagonal({1, 1})};

  for (std::int64_t k = 0; k < 400; ++k) {
    const auto i = static_cast<std::uint64_t>(k);
    const double theta_e = 400 * kTs * static_cast<double>(k);
    Measurement s{.k = k};
    const Vec2 y(std::cos(theta_e) + 0.1 * normal(1, 0, i),
                 std::sin(theta_e) + 0.1 * normal(1, 1, i));
    s.i_abc = inverse_clarke(y);
    s.u_alphabeta = {-3 * std::sin(theta_e) + normal(1, 2, i), 3 * std::cos(theta_e)};

    if (k == 0) {
      oracle.x.head(2) = y;  // the first sample is taken over
    } else {
      const double w = oracle.x[2], sine = std::sin(oracle.x[3]), cosine = std::cos(oracle.x[3]);
      VectorXd f(4);
      f << (s.u_alphabeta[0] - m.R_s * oracle.x[0] + m.psi_f * w * sine) / m.L_d,
          (s.u_alphabeta[1] - m.R_s * oracle.x[1] - m.psi_f * w * cosine) / m.L_d, 0, w;
      MatrixXd dfdx(4, 4);
      dfdx << -m.R_s / m.L_d, 0, m.psi_f * sine / m.L_d, m.psi_f * w * cosine / m.L_d,  //
          0, -m.R_s / m.L_d, -m.psi_f * cosine / m.L_d, m.psi_f * w * sine / m.L_d,     //
          0, 0, 0, 0,                                                                   //
          0, 0, 1, 0;
      oracle.step(f, dfdx, y);
    }
    const Estimate e = fast.tick(s);
    fast.take_gain(background.step(e));

    ASSERT_LT((e.x_hat.head<3>() - oracle.x.head(3)).norm(), 1e-9) << "tick " << k;
    ASSERT_NEAR(wrap_pi(e.x_hat[3] - oracle.x[3]), 0, 1e-9) << "tick " << k;
    ASSERT_EQ(e.gain_seq, k - 1);
  }
  // The run must not be 400 ticks of zeros.
  EXPECT_GT(oracle.x[2], 100);
}

TEST(TwoRateAtNOne, EqualsTheTextbookEkfOfTheDisturbanceModel) {
  const MachineParameters m{
      .R_s = 1.0, .L_d = 8e-3, .L_q = 14e-3, .psi_f = 0.25, .J = 8.8e-3, .B = 0.003, .n_p = 3};
  EkfDisturbanceParameters tuning;
  tuning.L = 0;  // without (25) it is an ordinary EKF
  const auto filter =
      std::make_shared<EkfDisturbance>(m, tuning, Prediction::kEuler, CovarianceForm::kJoseph, kTs);
  FastLoop fast(filter, GainPolicy::kPaper, 1);
  BackgroundLoop background(filter, GainPolicy::kPaper, 1);
  TextbookEkf oracle{VectorXd::Zero(4), MatrixXd::Identity(4, 4), diagonal({1, 2, 1.5, 0.1}),
                     diagonal({10, 10, 150})};

  double theta_m = 0, theta_m_before = 0;
  for (std::int64_t k = 0; k < 400; ++k) {
    const auto i = static_cast<std::uint64_t>(k);
    const double omega_m = 20 + 0.02 * static_cast<double>(k);
    theta_m_before = theta_m;
    theta_m += kTs * omega_m;
    VectorXd y(3);
    y << -1 + 0.2 * normal(2, 0, i), 4 + 0.2 * normal(2, 1, i), omega_m + 0.5 * normal(2, 2, i);
    const Vec2 u_dq(-5 + normal(2, 3, i), 20 + normal(2, 4, i));
    Measurement s{.k = k, .signals = kPhaseCurrents | kVoltage | kPosition | kSpeed};
    s.theta_m = theta_m;
    s.omega_m = y[2];
    s.i_abc = inverse_clarke(inverse_park(y.head<2>(), m.n_p * theta_m));
    // The voltage is constant in the stator; the filter sees it from the rotor's middle angle.
    s.u_alphabeta = inverse_park(u_dq, 0.5 * m.n_p * (theta_m_before + theta_m));

    if (k == 0) {
      oracle.x.head(3) = y;
    } else {
      const double i_d = oracle.x[0], i_q = oracle.x[1], w = m.n_p * oracle.x[2];
      VectorXd f(4);
      f << (u_dq[0] - m.R_s * i_d + w * m.L_q * i_q) / m.L_d,
          (u_dq[1] - m.R_s * i_q - w * m.L_d * i_d - w * m.psi_f) / m.L_q,
          (1.5 * m.n_p * (m.psi_f * i_q + (m.L_d - m.L_q) * i_d * i_q) - oracle.x[3]) / m.J, 0;
      MatrixXd dfdx = MatrixXd::Zero(4, 4);
      dfdx(0, 0) = -m.R_s / m.L_d;
      dfdx(0, 1) = w * m.L_q / m.L_d;
      dfdx(0, 2) = m.n_p * m.L_q * i_q / m.L_d;
      dfdx(1, 0) = -w * m.L_d / m.L_q;
      dfdx(1, 1) = -m.R_s / m.L_q;
      dfdx(1, 2) = -m.n_p * (m.L_d * i_d + m.psi_f) / m.L_q;
      dfdx(2, 0) = 1.5 * m.n_p * (m.L_d - m.L_q) * i_q / m.J;
      dfdx(2, 1) = 1.5 * m.n_p * (m.psi_f + (m.L_d - m.L_q) * i_d) / m.J;
      dfdx(2, 3) = -1 / m.J;
      oracle.step(f, dfdx, y);
    }
    const Estimate e = fast.tick(s);
    fast.take_gain(background.step(e));
    ASSERT_LT((e.x_hat.head<4>() - oracle.x).norm(), 1e-9) << "tick " << k;
  }
  EXPECT_GT(std::abs(oracle.x[3]), 0.01);
}

}  // namespace
}  // namespace twinrate::textbook_ekf_test
