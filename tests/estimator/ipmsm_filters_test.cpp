// The filters of the salient machine: Jacobians against central differences, predictions against
// the plant's own equations, and with n = 1 the textbook filter.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "estimator/active_flux.hpp"
#include "estimator/backemf_printed.hpp"
#include "estimator/dq_ekf.hpp"
#include "estimator/eemf.hpp"
#include "estimator/two_rate.hpp"
#include "model/random.hpp"
#include "plant_sim/integrator.hpp"
#include "tests/support/matrices.hpp"

namespace twinrate::ipmsm_filters_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::numerical_jacobian;

constexpr double kTs = 1e-4;

MachineParameters ipmsm() {
  return {.R_s = 11, .L_d = 0.05635, .L_q = 0.133, .psi_f = 0.285, .J = 1e-4, .B = 2e-4, .n_p = 2};
}

DqEkf dq_ekf(Prediction prediction, KnownStart start = {}) {
  return {ipmsm(), {}, prediction, CovarianceForm::kJoseph, kTs, start};
}
Eemf eemf(Prediction prediction, Rotation rotation = Rotation::kExact, KnownStart start = {}) {
  EemfParameters tuning;
  tuning.rotation = rotation;
  return {ipmsm(), tuning, prediction, CovarianceForm::kJoseph, kTs, start};
}
BackEmfPrinted printed(Prediction prediction, Rotation rotation = Rotation::kExact,
                       KnownStart start = {}) {
  BackEmfParameters tuning;
  tuning.rotation = rotation;
  return {ipmsm(), tuning, prediction, CovarianceForm::kJoseph, kTs, start};
}

TEST(DqEkf, JacobiansAreTheDerivativesOfPredictionAndOutput) {
  const DqEkf filter = dq_ekf(Prediction::kEuler);
  for (std::uint64_t k = 0; k < 20; ++k) {
    const DqEkf::State x(normal(1, 0, k), 2 * normal(1, 1, k), 300 * normal(1, 2, k),
                         3 * normal(1, 3, k));
    const Vec2 u(90 * normal(1, 4, k), 90 * normal(1, 5, k));
    const VectorXd step = Eigen::Vector4d(1e-4, 1e-4, 1e-2, 1e-5);
    const MatrixXd F = numerical_jacobian(
        [&](const VectorXd& s) -> VectorXd { return filter.predict(s, u); }, x, step);
    EXPECT_LT((filter.jacobian(x, park(u, x[3])) - F).cwiseAbs().maxCoeff(), 1e-7);
    const MatrixXd H = numerical_jacobian(
        [&](const VectorXd& s) -> VectorXd { return park(inverse_park(s.head<2>(), s[3]), x[3]); },
        x, step);
    EXPECT_LT((DqEkf::output_jacobian(x) - H).cwiseAbs().maxCoeff(), 1e-8);
  }
}

TEST(Eemf, JacobianIsTheDerivativeOfTheEulerPredictionWithEitherRotation) {
  for (Rotation rotation : {Rotation::kExact, Rotation::kEuler}) {
    const Eemf filter = eemf(Prediction::kEuler, rotation);
    for (std::uint64_t k = 0; k < 20; ++k) {
      Eemf::State x;
      x << normal(2, 0, k), normal(2, 1, k), 80 * normal(2, 2, k), 80 * normal(2, 3, k),
          300 * normal(2, 4, k);
      const Vec2 u(90 * normal(2, 5, k), 90 * normal(2, 6, k));
      VectorXd step(5);
      step << 1e-4, 1e-4, 1e-3, 1e-3, 1e-2;
      const MatrixXd F = numerical_jacobian(
          [&](const VectorXd& s) -> VectorXd { return filter.predict(s, u); }, x, step);
      EXPECT_LT((filter.jacobian(x) - F).cwiseAbs().maxCoeff(), 1e-7);
    }
  }
}

TEST(BackEmf, TransitionIsTheDerivativeOfTheEulerPredictionWithEitherRotation) {
  for (Rotation rotation : {Rotation::kExact, Rotation::kEuler}) {
    const BackEmfPrinted filter = printed(Prediction::kEuler, rotation);
    const MatrixXd F = numerical_jacobian(
        [&](const VectorXd& s) -> VectorXd {
          return filter.predict(s, {30, -20}, 400);
        },
        Eigen::Vector4d(1, -2, 60, 90), Eigen::Vector4d::Constant(1e-3));
    EXPECT_LT((filter.transition(400) - F).cwiseAbs().maxCoeff(), 1e-9);
  }
}

TEST(BackEmf, EulerRotationMakesTheEmfGrowAndTheExactOneDoesNot) {
  const auto growth = [](Rotation rotation) {
    return printed(Prediction::kEuler, rotation)
        .transition(419)
        .bottomRightCorner<2, 2>()
        .determinant();
  };
  EXPECT_NEAR(growth(Rotation::kExact), 1, 1e-12);
  EXPECT_NEAR(growth(Rotation::kEuler), 1 + 0.0419 * 0.0419, 1e-6);
}

// One period of the plant at a speed that stays, from random operating points.
struct Period {
  PlantState before, after;
  Vec2 u_alphabeta;
};

Period period_of(std::uint64_t k, Saliency saliency, double omega_m) {
  MachineParameters m = ipmsm();
  m.J = 1e6;  // the speed stays
  const DriveModel model(m, {}, 311, saliency);
  const auto integrator = make_integrator(Engine::kErk, model, 4);
  Period p;
  p.before = {normal(3, 0, k), 2 * normal(3, 1, k), omega_m, normal(3, 2, k)};
  p.u_alphabeta = {90 * normal(3, 3, k), 90 * normal(3, 4, k)};
  p.after = integrator->advance(p.before, {.u_alphabeta = p.u_alphabeta}, kTs);
  return p;
}

TEST(DqEkf, PredictsWhatThePlantDoesInOnePeriod) {
  for (std::uint64_t k = 0; k < 20; ++k) {
    const Period p = period_of(k, Saliency::kRotor, 180);
    const DqEkf::State x(p.before[0], p.before[1], 360, 2 * p.before[3]);
    for (Prediction prediction : {Prediction::kRk4, Prediction::kExact}) {
      const DqEkf::State next = dq_ekf(prediction).predict(x, p.u_alphabeta);
      EXPECT_LT((next.head<2>() - p.after.head<2>()).norm(), 1e-7);
      EXPECT_NEAR(next[3], 2 * p.after[3], 1e-9);
    }
    const DqEkf::State euler = dq_ekf(Prediction::kEuler).predict(x, p.u_alphabeta);
    EXPECT_LT((euler.head<2>() - p.after.head<2>()).norm(), 0.02);
    EXPECT_GT((euler.head<2>() - p.after.head<2>()).norm(), 1e-5);
  }
}

TEST(Eemf, PredictsTheSalientPlantWhoseExtendedEmfItKnows) {
  // Where i_q' is small the EMF keeps its length: the steady state of the voltage equation.
  const MachineParameters m = ipmsm();
  for (double omega_m : {150.0, -90.0}) {
    const double omega_e = 2 * omega_m, theta_e = 0.8;
    const Vec2 i_dq(-0.6, 1.5);
    const Vec2 u_dq(m.R_s * i_dq[0] - omega_e * m.L_q * i_dq[1],
                    m.R_s * i_dq[1] + omega_e * (m.L_d * i_dq[0] + m.psi_f));
    // Voltage that turns with the rotor over the period, as a constant vector at its middle.
    const Vec2 u = inverse_park(u_dq, theta_e + 0.5 * kTs * omega_e);
    Eemf::State x;
    const double E_ex = omega_e * (m.psi_f + (m.L_d - m.L_q) * i_dq[0]);
    x << inverse_park(i_dq, theta_e), inverse_park({0, E_ex}, theta_e), omega_e;
    for (Prediction prediction : {Prediction::kRk4, Prediction::kExact}) {
      const Eemf::State next = eemf(prediction).predict(x, u);
      EXPECT_LT((park(next.head<2>(), theta_e + kTs * omega_e) - i_dq).norm(), 1e-4);
      EXPECT_LT((park(next.segment<2>(2), theta_e + kTs * omega_e) - Vec2(0, E_ex)).norm(), 1e-4);
    }
  }
}

TEST(BackEmfPrinted, PredictsTheFixedAxesPlantAndNotASalientOne) {
  const auto error = [](std::uint64_t k, Saliency saliency) {
    const Period p = period_of(k, saliency, 180);
    const double theta_e = 2 * p.before[3];
    BackEmfFilter::State x;
    x << inverse_park(p.before.head<2>(), theta_e), inverse_park({0, 360 * 0.285}, theta_e);
    const auto next = printed(Prediction::kRk4).predict(x, p.u_alphabeta, 360);
    return (next.head<2>() - inverse_park(p.after.head<2>(), 2 * p.after[3])).norm();
  };
  for (std::uint64_t k = 0; k < 10; ++k) {
    EXPECT_LT(error(k, Saliency::kFixedAxes), 1e-7) << k;
    EXPECT_GT(error(k, Saliency::kRotor), 1e-3) << k;
  }
}

// The filter as a textbook writes it: F, H and the predicted state are given.
struct TextbookEkf {
  VectorXd x;
  MatrixXd P, Q, R;
  void step(const VectorXd& x_prior, const MatrixXd& F, const MatrixXd& H, const VectorXd& innov) {
    const MatrixXd P_prior = F * P * F.transpose() + Q;
    const MatrixXd S = H * P_prior * H.transpose() + R;
    const MatrixXd K = S.ldlt().solve(H * P_prior).transpose();
    x = x_prior + K * innov;
    const MatrixXd I_KH = MatrixXd::Identity(x.size(), x.size()) - K * H;
    P = I_KH * P_prior * I_KH.transpose() + K * R * K.transpose();
  }
};

// A drive at constant speed with noise on top.
Measurement sample(std::int64_t k) {
  const auto i = static_cast<std::uint64_t>(k);
  const double theta_e = 200 * kTs * static_cast<double>(k);
  Measurement s{.k = k};
  const Vec2 y = inverse_park({-0.4, 1.2}, theta_e) + 0.01 * Vec2(normal(4, 0, i), normal(4, 1, i));
  s.i_abc = inverse_clarke(y);
  s.u_alphabeta = inverse_park({-36, 70}, theta_e - 100 * kTs) + Vec2(normal(4, 2, i), 0);
  return s;
}

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
  EXPECT_GT(std::abs(oracle.x[4]), 50);  // a speed was found: the run was one
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
    // The background's voltage is the last period's, held in rotor axes.
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
    // Euler takes the voltage at the period's start; the background knows it at the middle.
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
  // x = [i_q^s, i_d^s, E_q^s, E_d^s], q^s = alpha, d^s = -beta; (22) with its signs mended.
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

TEST(FlyingStart, BeginsOnTheAngleAndSpeedThatAreKnown) {
  for (double omega_e : {300.0, -300.0}) {
    const KnownStart known{1.3, omega_e};
    const DqEkf dq = dq_ekf(Prediction::kRk4, known);
    const Eemf ex = eemf(Prediction::kRk4, Rotation::kExact, known);
    const BackEmfPrinted pr = printed(Prediction::kEuler, Rotation::kExact, known);
    for (const Filter* filter : std::initializer_list<const Filter*>{&dq, &ex, &pr}) {
      const Estimate e = filter->output(filter->start({}), {});
      EXPECT_NEAR(wrap_pi(e.theta_e - 1.3), 0, 1e-12) << filter->kind();
      EXPECT_NEAR(e.omega_m, omega_e / 2, 1e-12) << filter->kind();
    }
  }
}

TEST(Alignment, LeavesTheFilterAtTheForcedAngleAndAtRest) {
  const DqEkf dq = dq_ekf(Prediction::kRk4, {0.2, 100});
  const BackEmfPrinted pr = printed(Prediction::kEuler, Rotation::kExact, {0.2, 100});
  for (const Filter* filter : std::initializer_list<const Filter*>{&dq, &pr}) {
    Measurement m;
    m.i_abc = inverse_clarke({1, 2});
    FastState state = filter->start(m);
    filter->align(state, 4.0);
    const Estimate e = filter->output(state, m);
    EXPECT_NEAR(e.theta_e, 4.0, 1e-12);
    EXPECT_EQ(e.omega_m, 0);
    EXPECT_LT((inverse_park(e.i_dq, e.theta_e) - Vec2(1, 2)).norm(), 1e-12) << filter->kind();
  }
}

TEST(AllFourFilters, KeepTheirPredictionAndSaySoWhenASampleIsNotFinite) {
  const DqEkf dq = dq_ekf(Prediction::kRk4);
  const Eemf ex = eemf(Prediction::kRk4);
  const BackEmfPrinted pr = printed(Prediction::kEuler);
  const ActiveFlux af(ipmsm(), {}, Prediction::kEuler, CovarianceForm::kJoseph, kTs, {});
  for (const Filter* filter : std::initializer_list<const Filter*>{&dq, &ex, &pr, &af}) {
    FastState state = filter->start(sample(0));
    Gain gain = filter->initial_gain();
    gain.K.setConstant(0.1);
    Measurement broken = sample(1);
    broken.i_abc[0] = std::numeric_limits<double>::quiet_NaN();
    FastState bridged = state;
    filter->predict_over_gap(bridged, broken);
    EXPECT_EQ(filter->fast_step(state, broken, gain).status, kNotFinite) << filter->kind();
    EXPECT_TRUE(state.x_hat.allFinite());
    EXPECT_EQ(state.x_hat, bridged.x_hat);
  }
}

}  // namespace
}  // namespace twinrate::ipmsm_filters_test
