// The filters of the salient machine with n = 1 equal the textbook filter, implemented here
// independently.
#include <gtest/gtest.h>

#include "estimator/two_rate.hpp"
#include "model/linear_algebra.hpp"
#include "tests/estimator/ipmsm_filters.hpp"

namespace twinrate::ipmsm_filters_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// The textbook filter with given F, H and predicted state.
struct TextbookEkf {
  VectorXd x;
  MatrixXd P, Q, R;
  void step(const VectorXd& x_prior, const MatrixXd& F, const MatrixXd& H, const VectorXd& innov) {
    const MatrixXd P_prior = F * P * F.transpose() + Q;
    const MatrixXd S = H * P_prior * H.transpose() + R;
    const MatrixXd K = linear::solve_symmetric(S, H * P_prior).transpose();
    x = x_prior + K * innov;
    const MatrixXd I_KH = MatrixXd::Identity(x.size(), x.size()) - K * H;
    P = I_KH * P_prior * I_KH.transpose() + K * R * K.transpose();
  }
};

template <class Oracle, class Step>
void run_against_textbook(std::shared_ptr<const Filter> filter, Oracle& oracle, double tolerance,
                          const Step& step) {
  FastLoop fast(filter, GainPolicy::kPaper, 1);
  BackgroundLoop background(filter, GainPolicy::kPaper, 1);
  const Eigen::Index n_x = oracle.x.size();
  for (std::int64_t k = 0; k < 300; ++k) {
    const Measurement s = sample(k);
    if (k == 0)
      oracle.x.head(2) = clarke(s.i_abc);
    else
      step(s);
    const Estimate e = fast.tick(s);
    fast.take_gain(background.step(e));
    ASSERT_LT((e.x_hat.head(n_x) - oracle.x).norm(), tolerance * (1 + oracle.x.norm()))
        << "tick " << k;
  }
}

TEST(TwoRateAtNOne, EqualsTheTextbookEkfOfTheExtendedEmfModel) {
  const MachineParameters m = ipmsm();
  const auto filter = std::make_shared<Eemf>(eemf(Prediction::kEuler, Rotation::kEuler));
  const Gain start = filter->initial_gain();
  TextbookEkf oracle{VectorXd::Zero(5), start.P.topLeftCorner<5, 5>(), MatrixXd::Zero(5, 5),
                     1e-3 * MatrixXd::Identity(2, 2)};
  oracle.Q.diagonal() << 1e-4, 1e-4, 0.5, 0.5, 4;
  const MatrixXd H = MatrixXd::Identity(2, 5);
  run_against_textbook(filter, oracle, 1e-9, [&](const Measurement& s) {
    const VectorXd x = oracle.x;
    const double w = x[4], dL = m.L_d - m.L_q;
    MatrixXd A = MatrixXd::Zero(5, 5);
    A.row(0) << -m.R_s, -w * dL, -1, 0, -dL * x[1];
    A.row(1) << w * dL, -m.R_s, 0, -1, dL * x[0];
    A.topRows(2) /= m.L_d;
    A.row(2) << 0, 0, 0, -w, -x[3];
    A.row(3) << 0, 0, w, 0, x[2];
    VectorXd f(5);
    f << (s.u_alphabeta[0] - m.R_s * x[0] - w * dL * x[1] - x[2]) / m.L_d,
        (s.u_alphabeta[1] - m.R_s * x[1] + w * dL * x[0] - x[3]) / m.L_d, -w * x[3], w * x[2], 0;
    const VectorXd x_prior = x + kTs * f;
    oracle.step(x_prior, MatrixXd::Identity(5, 5) + kTs * A, H, clarke(s.i_abc) - x_prior.head(2));
  });
  EXPECT_GT(std::abs(oracle.x[4]), 50);  // the run has a speed
}

TEST(TwoRateAtNOne, EqualsTheTextbookEkfOfTheRotorModelWithItsOutputInTheStator) {
  const MachineParameters m = ipmsm();
  const auto filter = std::make_shared<DqEkf>(dq_ekf(Prediction::kEuler));
  TextbookEkf oracle{VectorXd::Zero(4), filter->initial_gain().P.topLeftCorner<4, 4>(),
                     MatrixXd::Zero(4, 4), 1e-3 * MatrixXd::Identity(2, 2)};
  oracle.Q.diagonal() << 1e-4, 1e-4, 4, 1e-6;
  Vec2 u_dq_before = Vec2::Zero();
  run_against_textbook(filter, oracle, 1e-9, [&](const Measurement& s) {
    const VectorXd x = oracle.x;
    // The background uses the voltage of the last period, constant in rotor axes.
    const Vec2 u_b = u_dq_before;
    const auto predict = [&](const Vec2& u_dq) {
      VectorXd f(4);
      f << (u_dq[0] - m.R_s * x[0] + x[2] * m.L_q * x[1]) / m.L_d,
          (u_dq[1] - m.R_s * x[1] - x[2] * (m.L_d * x[0] + m.psi_f)) / m.L_q, 0, x[2];
      return VectorXd(x + kTs * f);
    };
    MatrixXd A = MatrixXd::Zero(4, 4);
    A.row(0) << -m.R_s, x[2] * m.L_q, m.L_q * x[1], u_b[1];
    A.row(1) << -x[2] * m.L_d, -m.R_s, -(m.L_d * x[0] + m.psi_f), -u_b[0];
    A.row(0) /= m.L_d;
    A.row(1) /= m.L_q;
    A(3, 2) = 1;
    // Euler needs the voltage at the start of the period; the background has it at the middle.
    const VectorXd linearised_at = predict(rotate(u_b, 0.5 * kTs * x[2]));
    const VectorXd x_prior = predict(park(s.u_alphabeta, x[3]));
    // y = R(theta) i_dq in the stator, its Jacobian by the product rule.
    const double c = std::cos(x_prior[3]), sn = std::sin(x_prior[3]);
    MatrixXd H(2, 4);
    H << c, -sn, 0, -sn * linearised_at[0] - c * linearised_at[1],  //
        sn, c, 0, c * linearised_at[0] - sn * linearised_at[1];
    oracle.step(x_prior, MatrixXd::Identity(4, 4) + kTs * A, H,
                clarke(s.i_abc) - inverse_park(x_prior.head<2>(), x_prior[3]));
    oracle.x[3] = wrap_turn(oracle.x[3]);
    u_dq_before = park(s.u_alphabeta, x_prior[3] - 0.5 * kTs * x_prior[2]);
  });
  EXPECT_GT(std::abs(oracle.x[2]), 50);
}

TEST(TwoRateAtNOne, EqualsTheTextbookFilterOfThePaperInThePapersOwnAxes) {
  const MachineParameters m = ipmsm();
  const auto filter =
      std::make_shared<BackEmfPrinted>(printed(Prediction::kEuler, Rotation::kEuler));
  FastLoop fast(filter, GainPolicy::kPaper, 1);
  BackgroundLoop background(filter, GainPolicy::kPaper, 1);
  // x = [i_q^s, i_d^s, E_q^s, E_d^s], q^s = alpha, d^s = -beta; (22) with corrected signs.
  TextbookEkf oracle{VectorXd::Zero(4), MatrixXd::Zero(4, 4), MatrixXd::Zero(4, 4),
                     0.5 * MatrixXd::Identity(2, 2)};
  oracle.P.diagonal() << 0.1, 0.1, 200, 10;
  oracle.Q.diagonal() << 2e3, 2e3, 80e3, 10e3;
  const MatrixXd H = MatrixXd::Identity(2, 4);
  double omega_e = 0;
  for (std::int64_t k = 0; k < 300; ++k) {
    const Measurement s = sample(k);
    const Vec2 y = clarke(s.i_abc), y_qd(y[0], -y[1]), u_qd(s.u_alphabeta[0], -s.u_alphabeta[1]);
    if (k == 0) {
      oracle.x.head(2) = y_qd;
    } else {
      MatrixXd Phi(4, 4);
      Phi << 1 - m.R_s / m.L_q * kTs, 0, -kTs / m.L_q, 0,  //
          0, 1 - m.R_s / m.L_d * kTs, 0, -kTs / m.L_d,     //
          0, 0, 1, omega_e * kTs,                          //
          0, 0, -omega_e * kTs, 1;
      VectorXd x_prior = Phi * oracle.x;
      x_prior[0] += kTs / m.L_q * u_qd[0];
      x_prior[1] += kTs / m.L_d * u_qd[1];
      oracle.step(x_prior, Phi, H, y_qd - x_prior.head(2));
    }
    const Estimate e = fast.tick(s);
    fast.take_gain(background.step(e));
    omega_e = 2 * e.omega_m;
    const Eigen::Vector4d x_qd(e.x_hat[0], -e.x_hat[1], e.x_hat[2], -e.x_hat[3]);
    ASSERT_LT((x_qd - oracle.x).norm(), 1e-9 * (1 + oracle.x.norm())) << "tick " << k;
  }
  EXPECT_GT(oracle.x.tail(2).norm(), 20);
}

}  // namespace
}  // namespace twinrate::ipmsm_filters_test
