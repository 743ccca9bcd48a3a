#include "estimator/ekf_disturbance.hpp"

#include <gtest/gtest.h>

#include "estimator/two_rate.hpp"
#include "model/random.hpp"
#include "tests/support/matrices.hpp"

namespace twinrate {
namespace {

constexpr double kTs = 1e-4;

MachineParameters salient_machine() {
  return {.R_s = 1.0, .L_d = 8e-3, .L_q = 14e-3, .psi_f = 0.25, .J = 8.8e-3, .n_p = 3};
}

EkfDisturbance filter(Prediction prediction, CovarianceForm form = CovarianceForm::kJoseph,
                      const EkfDisturbanceParameters& tuning = {}) {
  return EkfDisturbance(salient_machine(), tuning, prediction, form, kTs);
}

Eigen::Vector4d random_state(std::uint64_t i) {
  return {4 * normal(3, 0, i), 6 * normal(3, 1, i), 60 * normal(3, 2, i), 3 * normal(3, 3, i)};
}

TEST(EkfDisturbance, JacobianIsTheDerivativeOfTheEulerStepWithSaliency) {
  const auto f = filter(Prediction::kEuler);
  const Eigen::Vector4d step(1e-3, 1e-3, 1e-3, 1e-3);
  for (std::uint64_t i = 0; i < 50; ++i) {
    const Eigen::Vector4d x = random_state(i);
    const auto euler = [&](const Eigen::VectorXd& s) -> Eigen::VectorXd {
      return f.predict(s, Vec2(10, -20));
    };
    EXPECT_LT((f.jacobian(x) - test::numerical_jacobian(euler, x, step)).cwiseAbs().maxCoeff(),
              1e-8);
  }
}

TEST(EkfDisturbance, Rk4AndExactPredictionsFollowFineIntegration) {
  const auto rk4 = filter(Prediction::kRk4), exact = filter(Prediction::kExact),
             euler = filter(Prediction::kEuler);
  double worst_rk4 = 0, worst_exact = 0, worst_euler = 0;
  for (std::uint64_t i = 0; i < 30; ++i) {
    const Eigen::Vector4d x = random_state(i);
    const Vec2 u_dq(20 * normal(4, 0, i), 20 * normal(4, 1, i));
    // Ten thousand midpoint steps of the header's equations, written out again.
    const MachineParameters m = salient_machine();
    Eigen::Vector4d y = x;
    const double h = kTs / 10000;
    const auto rate = [&](const Eigen::Vector4d& s) {
      const double w = m.n_p * s[2];
      return Eigen::Vector4d((u_dq[0] - m.R_s * s[0] + w * m.L_q * s[1]) / m.L_d,
                             (u_dq[1] - m.R_s * s[1] - w * (m.L_d * s[0] + m.psi_f)) / m.L_q,
                             (1.5 * m.n_p * (m.psi_f + (m.L_d - m.L_q) * s[0]) * s[1] - s[3]) / m.J,
                             0);
    };
    for (int j = 0; j < 10000; ++j) y += h * rate(Eigen::Vector4d(y + 0.5 * h * rate(y)));
    worst_rk4 = std::max(worst_rk4, (rk4.predict(x, u_dq) - y).norm());
    worst_exact = std::max(worst_exact, (exact.predict(x, u_dq) - y).norm());
    worst_euler = std::max(worst_euler, (euler.predict(x, u_dq) - y).norm());
  }
  EXPECT_LT(worst_rk4, 1e-7);
  EXPECT_LT(worst_exact, 2e-3);  // speed frozen over the interval: second order in T_s
  EXPECT_GT(worst_exact, 1e-9);
  EXPECT_LT(worst_exact, 0.2 * worst_euler);
}

// A measurement of a machine in steady state at i_dq, omega_m, with the voltage that
// holds it.
Measurement steady(std::int64_t k, const MachineParameters& m, const Vec2& i_dq, double omega_m,
                   int signals) {
  const double w = m.n_p * omega_m;
  const Vec2 u_dq(m.R_s * i_dq[0] - w * m.L_q * i_dq[1],
                  m.R_s * i_dq[1] + w * (m.L_d * i_dq[0] + m.psi_f));
  Measurement s{.k = k, .signals = signals};
  s.theta_m = omega_m * kTs * static_cast<double>(k);
  s.omega_m = omega_m;
  s.i_abc = inverse_clarke(inverse_park(i_dq, m.n_p * s.theta_m));
  s.u_alphabeta = inverse_park(u_dq, m.n_p * (s.theta_m - 0.5 * omega_m * kTs));
  return s;
}

template <class MakeSample>
Estimate run(const std::shared_ptr<const Filter>& f, int n, int ticks, const MakeSample& sample) {
  FastLoop fast(f, GainPolicy::kPaper, n);
  BackgroundLoop background(f, GainPolicy::kPaper, n);
  Estimate e;
  for (std::int64_t k = 0; k < ticks; ++k) {
    e = fast.tick(sample(k));
    if (is_snapshot(k, n)) fast.take_gain(background.step(e));
  }
  return e;
}

constexpr int kFull = kPhaseCurrents | kVoltage | kPosition | kSpeed;
constexpr int kNoVoltageSignals = kPhaseCurrents | kPosition | kSpeed;

TEST(EkfDisturbance, AtConstantSpeedTheLoadIsTheTorqueOfTheCurrents) {
  const MachineParameters m = salient_machine();
  const Vec2 i_dq(-2, 5);
  // 1.5 * 3 * (0.25 + 0.006 * 2) * 5
  const double T_em = 5.895;
  for (int n : {1, 4}) {
    for (int signals : {kFull, kNoVoltageSignals}) {
      const auto f = std::make_shared<EkfDisturbance>(filter(Prediction::kRk4));
      const Estimate e =
          run(f, n, 30000, [&](std::int64_t k) { return steady(k, m, i_dq, 30, signals); });
      EXPECT_NEAR(e.T_load, T_em, 1e-3) << "n = " << n << ", signals " << signals;
      EXPECT_NEAR(e.omega_m, 30, 1e-4);
      EXPECT_NEAR((e.i_dq - i_dq).norm(), 0, 1e-3);
      EXPECT_EQ((e.status & kNoVoltage) != 0, signals == kNoVoltageSignals);
      EXPECT_EQ(e.n_x, signals == kFull ? 4 : 2);
    }
  }
}

TEST(EkfDisturbance, TheBackgroundTakesSnapshotsOfItsTwoFormsAlone) {
  const auto f = std::make_shared<EkfDisturbance>(filter(Prediction::kRk4));
  const BackgroundLoop background(f, GainPolicy::kPaper, 1);
  EXPECT_TRUE(background.fits({.n_x = 4}));
  EXPECT_FALSE(background.fits({.n_x = 2}));
  EXPECT_TRUE(background.fits({.status = kNoVoltage, .n_x = 2}));
  EXPECT_FALSE(background.fits({.status = kNoVoltage, .n_x = 1}));
  EXPECT_EQ(f->initial_gain_without_voltage().n_y, 1);
}

TEST(EkfDisturbance, OnASpeedRampTheLoadIsWhatAccelerationLeavesOver) {
  // T_o = T_em - J omega'; 4.5 * 0.25 * 2 - 8.8e-3 * 100 = 1.37 Nm
  const auto f = std::make_shared<EkfDisturbance>(filter(Prediction::kEuler));
  const Estimate e = run(f, 1, 20000, [&](std::int64_t k) {
    const double t = kTs * static_cast<double>(k);
    Measurement s{.k = k, .signals = kNoVoltageSignals};
    s.omega_m = 100 * t;
    s.theta_m = 50 * t * t;
    s.i_abc = inverse_clarke(inverse_park({0, 2}, 3 * s.theta_m));
    return s;
  });
  EXPECT_NEAR(e.T_load, 1.37, 1e-3);
}

TEST(EkfDisturbance, ASpeedBelowThePredictionMeansMoreLoad) {
  for (int signals : {kFull, kNoVoltageSignals}) {
    const auto f = filter(Prediction::kEuler);
    const MachineParameters m = salient_machine();
    FastState state = f.start(steady(0, m, {0, 0}, 30, signals));
    Measurement s = steady(1, m, {0, 0}, 30, signals);
    s.omega_m = 29;
    f.fast_step(state, s, f.initial_gain());  // K = 0: (25) alone
    const double T_load = f.output(state, s).T_load;
    EXPECT_NEAR(T_load, 700 * kTs * 1.0, 1e-9) << signals;
  }
}

TEST(EkfDisturbance, SpeedFromTheAngleIsItsDifferenceOverTs) {
  EkfDisturbanceParameters tuning;
  tuning.speed_from_angle = true;
  const auto f =
      std::make_shared<EkfDisturbance>(filter(Prediction::kEuler, CovarianceForm::kJoseph, tuning));
  const MachineParameters m = salient_machine();
  const Estimate e = run(f, 1, 30000, [&](std::int64_t k) {
    Measurement s = steady(k, m, {0, 3}, 25, kNoVoltageSignals);
    s.omega_m = -999;  // must not be looked at
    return s;
  });
  EXPECT_NEAR(e.omega_m, 25, 1e-3);
  EXPECT_NEAR(e.T_load, 4.5 * 0.25 * 3, 1e-2);
}

TEST(EkfDisturbance, CovarianceStaysSymmetricAndPositiveInBothForms) {
  for (CovarianceForm form : {CovarianceForm::kJoseph, CovarianceForm::kPaper}) {
    for (int n_x : {4, 2}) {
      const auto f = filter(Prediction::kEuler, form);
      Gain gain = f.initial_gain();
      for (int i = 0; i < 1000; ++i) {
        Estimate snapshot{.k = i, .n_x = n_x};
        snapshot.x_hat.head<4>() = random_state(static_cast<std::uint64_t>(i));
        gain = f.background_step(gain, snapshot);
        const Eigen::MatrixXd P = gain.P.topLeftCorner(n_x, n_x);
        ASSERT_LT(test::asymmetry(P), form == CovarianceForm::kJoseph ? 1e-13 : 1e-9);
        ASSERT_GT(test::smallest_eigenvalue(P), 0);
      }
    }
  }
}

TEST(EkfDisturbance, JosephAndPaperCovarianceAgreeToRounding) {
  const auto joseph = filter(Prediction::kEuler, CovarianceForm::kJoseph);
  const auto paper = filter(Prediction::kEuler, CovarianceForm::kPaper);
  Gain a = joseph.initial_gain(), b = paper.initial_gain();
  for (int i = 0; i < 300; ++i) {
    Estimate snapshot{.k = i, .n_x = 4};
    snapshot.x_hat.head<4>() = random_state(static_cast<std::uint64_t>(i));
    a = joseph.background_step(a, snapshot);
    b = paper.background_step(b, snapshot);
    ASSERT_LT((a.P - b.P).norm(), 1e-9 * a.P.norm());
    ASSERT_LT((a.K - b.K).norm(), 1e-9 * a.K.norm());
  }
}

TEST(EkfDisturbance, OneOutputAfterTheOtherAgreesWithJosephToRounding) {
  const auto joseph = filter(Prediction::kEuler, CovarianceForm::kJoseph);
  const auto sequential = filter(Prediction::kEuler, CovarianceForm::kSequential);
  Gain a = joseph.initial_gain(), b = sequential.initial_gain();
  for (int i = 0; i < 300; ++i) {
    Estimate snapshot{.k = i, .n_x = 4};
    snapshot.x_hat.head<4>() = random_state(static_cast<std::uint64_t>(i));
    a = joseph.background_step(a, snapshot);
    b = sequential.background_step(b, snapshot);
    ASSERT_LT((a.P - b.P).norm(), 1e-9 * a.P.norm());
    ASSERT_LT((a.K - b.K).norm(), 1e-9 * a.K.norm());
  }
}

TEST(EkfDisturbance, TheReducedGainSettlesOnTheRiccatiEquationsSolution) {
  const auto f = filter(Prediction::kEuler);
  Gain gain = f.initial_gain();
  for (int i = 0; i < 20000; ++i) gain = f.background_step(gain, {.k = i, .n_x = 2});
  // P^- = F (P^- - P^- H' S^-1 H P^-) F' + Q must leave no residual.
  Eigen::Matrix2d F, Q = Vec2(1.5, 0.1).asDiagonal();
  F << 1, -kTs / 8.8e-3, 0, 1;
  const Eigen::Matrix2d P = gain.P.topLeftCorner<2, 2>(), prior = F * P * F.transpose() + Q;
  const Eigen::Matrix2d posterior = prior - prior.col(0) * prior.row(0) / (prior(0, 0) + 150);
  EXPECT_LT((posterior - P).norm(), 1e-9 * P.norm());
  EXPECT_NEAR(gain.K(0, 0), P(0, 0) / 150, 1e-12);  // K = P H' R^-1
}

// From one tick to the next without a voltage: the torque is that of the mean current.
TEST(EkfDisturbance, TheReducedPredictionTakesTheMeanOfTheCurrentsAtBothEnds) {
  const auto f = filter(Prediction::kEuler);
  const MachineParameters m = salient_machine();
  FastState state = f.start(steady(0, m, {0, 1}, 30, kNoVoltageSignals));
  Gain none = f.initial_gain();
  none.n_x = 2, none.n_y = 1;
  const Correction correction =
      f.fast_step(state, steady(1, m, {0, 3}, 30, kNoVoltageSignals), none);
  // 3/2 n_p psi_f 2 A = 2.25 Nm
  EXPECT_NEAR(correction.innov[0], -kTs / 8.8e-3 * 2.25, 1e-12);
}

}  // namespace
}  // namespace twinrate
