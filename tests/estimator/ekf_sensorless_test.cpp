#include "estimator/ekf_sensorless.hpp"

#include <gtest/gtest.h>

#include <tuple>

#include "model/random.hpp"
#include "tests/support/matrices.hpp"

namespace twinrate::ekf_sensorless_test {
namespace {

constexpr double kTs = 2e-4;

MachineParameters machine() {
  return {.R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .B = 1e-5, .n_p = 4};
}

EkfSensorless filter(Prediction prediction, CovarianceForm form = CovarianceForm::kJoseph) {
  return EkfSensorless(machine(), {}, prediction, form, kTs);
}

// [i_alpha, i_beta, omega_e, theta_e] within the drive's operating range.
Eigen::Vector4d random_state(std::uint64_t i) {
  return {2 * normal(1, 0, i), 2 * normal(1, 1, i), 600 * normal(1, 2, i),
          kTwoPi * uniform(1, 6, i)};
}
Vec2 random_voltage(std::uint64_t i) {
  return {6 * normal(2, 0, i), 6 * normal(2, 1, i)};
}

// Oracle: the machine's equations with fine steps, at constant speed.
Eigen::Vector4d fine(const Eigen::Vector4d& x, const Vec2& u) {
  const MachineParameters m = machine();
  constexpr int kSteps = 2000;
  const double h = kTs / kSteps;
  Eigen::Vector4d y = x;
  const auto emf = [&](double theta) {  // d psi/dt of the magnet flux psi_f [cos, sin]
    return Vec2(-m.psi_f * x[2] * std::sin(theta), m.psi_f * x[2] * std::cos(theta));
  };
  for (int i = 0; i < kSteps; ++i) {
    const Vec2 current = y.head<2>();
    const double theta_mid = y[3] + 0.5 * h * x[2];
    // Trapezoidal rule in the current, midpoint in the EMF.
    const Vec2 b = current + h / m.L_d * (u - 0.5 * m.R_s * current - emf(theta_mid));
    y.head<2>() = b / (1 + 0.5 * h * m.R_s / m.L_d);
    y[3] += h * x[2];
  }
  return y;
}

TEST(EkfSensorless, JacobianIsTheDerivativeOfTheEulerStep) {
  const auto f = filter(Prediction::kEuler);
  const Eigen::Vector4d step(1e-4, 1e-4, 1e-2, 1e-5);
  for (std::uint64_t i = 0; i < 50; ++i) {
    const Eigen::Vector4d x = random_state(i);
    const Vec2 u = random_voltage(i);
    const auto euler = [&](const Eigen::VectorXd& s) -> Eigen::VectorXd { return f.predict(s, u); };
    const Eigen::Matrix4d numerical = test::numerical_jacobian(euler, x, step);
    EXPECT_LT((f.jacobian(x) - numerical).cwiseAbs().maxCoeff(), 1e-6);
  }
}

TEST(EkfSensorless, JacobianIsIdentityPlusTimesTheContinuousOneWhateverThePrediction) {
  const auto rk4 = filter(Prediction::kRk4), euler = filter(Prediction::kEuler);
  const Eigen::Vector4d x = random_state(3);
  EXPECT_EQ(rk4.jacobian(x), euler.jacobian(x));
}

TEST(EkfSensorless, ExactPredictionIsTheMachineAtConstantSpeed) {
  const auto f = filter(Prediction::kExact);
  for (std::uint64_t i = 0; i < 30; ++i) {
    const Eigen::Vector4d x = random_state(i);
    const Vec2 u = random_voltage(i);
    EXPECT_LT((f.predict(x, u) - fine(x, u)).cwiseAbs().maxCoeff(), 1e-6);
  }
}

TEST(EkfSensorless, Rk4PredictionIsCloseToTheMachineAndEulerIsNot) {
  double worst_rk4 = 0, worst_euler = 0;
  const auto rk4 = filter(Prediction::kRk4), euler = filter(Prediction::kEuler);
  for (std::uint64_t i = 0; i < 30; ++i) {
    const Eigen::Vector4d x = random_state(i), truth = fine(x, random_voltage(i));
    worst_rk4 = std::max(worst_rk4, (rk4.predict(x, random_voltage(i)) - truth).norm());
    worst_euler = std::max(worst_euler, (euler.predict(x, random_voltage(i)) - truth).norm());
  }
  EXPECT_LT(worst_rk4, 5e-3);  // (a T)^5/120 of ten amperes, a T = 0.48
  EXPECT_GT(worst_euler, 0.1);
  EXPECT_LT(worst_euler, 3);
}

TEST(EkfSensorless, EmfOfAForwardTurningRotorAtZeroAngleDrivesBetaDown) {
  // theta_e = 0, omega_e > 0: the flux on alpha turns towards beta, the EMF on +beta opposes
  // i_beta.
  const auto rate = filter(Prediction::kEuler).f({0, 0, 100, 0}, Vec2::Zero());
  EXPECT_EQ(rate[0], 0);
  EXPECT_NEAR(rate[1], -0.007 * 100 / 5e-4, 1e-9);
  EXPECT_EQ(rate[3], 100);
}

TEST(EkfSensorless, AQuarterTurnOnTheEmfDrivesAlphaUp) {
  EXPECT_NEAR(filter(Prediction::kEuler).f({0, 0, 100, kPi / 2}, Vec2::Zero())[0],
              0.007 * 100 / 5e-4, 1e-9);
}

TEST(EkfSensorless, CovarianceStaysSymmetricAndPositiveOverAThousandBackgroundSteps) {
  for (CovarianceForm form : {CovarianceForm::kJoseph, CovarianceForm::kPaper}) {
    const auto f = filter(Prediction::kEuler, form);
    Gain gain = f.initial_gain();
    for (int i = 0; i < 1000; ++i) {
      Estimate snapshot{.k = i};
      // Forty rad of rotation at 400 rad/s, with current.
      snapshot.x_hat.head<4>() << std::cos(0.08 * i), std::sin(0.08 * i), 400, wrap_turn(0.08 * i);
      gain = f.background_step(gain, snapshot);
      const Eigen::Matrix4d P = gain.P.topLeftCorner<4, 4>();
      ASSERT_LT(test::asymmetry(P), form == CovarianceForm::kJoseph ? 1e-13 : 1e-10);
      ASSERT_GT(test::smallest_eigenvalue(P), 0);
    }
  }
}

TEST(EkfSensorless, JosephAndPaperCovarianceAgreeToRounding) {
  const auto joseph = filter(Prediction::kEuler, CovarianceForm::kJoseph);
  const auto paper = filter(Prediction::kEuler, CovarianceForm::kPaper);
  Gain a = joseph.initial_gain(), b = paper.initial_gain();
  for (int i = 0; i < 300; ++i) {
    Estimate snapshot{.k = i};
    snapshot.x_hat.head<4>() = random_state(static_cast<std::uint64_t>(i));
    a = joseph.background_step(a, snapshot);
    b = paper.background_step(b, snapshot);
    ASSERT_LT((a.P - b.P).norm(), 1e-9 * a.P.norm());
    ASSERT_LT((a.K - b.K).norm(), 1e-9 * a.K.norm());
  }
}

TEST(EkfSensorless, OneOutputAfterTheOtherAgreesWithJosephToRounding) {
  const auto joseph = filter(Prediction::kEuler, CovarianceForm::kJoseph);
  const auto sequential = filter(Prediction::kEuler, CovarianceForm::kSequential);
  Gain a = joseph.initial_gain(), b = sequential.initial_gain();
  for (int i = 0; i < 300; ++i) {
    Estimate snapshot{.k = i};
    snapshot.x_hat.head<4>() = random_state(static_cast<std::uint64_t>(i));
    a = joseph.background_step(a, snapshot);
    b = sequential.background_step(b, snapshot);
    ASSERT_LT((a.P - b.P).norm(), 1e-9 * a.P.norm());
    ASSERT_LT((a.K - b.K).norm(), 1e-9 * a.K.norm());
  }
}

TEST(EkfSensorless, NoGainBeforeTheFirstBackgroundStepAndP0ByTheFile) {
  EkfSensorlessParameters tuning;
  tuning.P0_diag[2] = 7;
  const EkfSensorless f(machine(), tuning, Prediction::kEuler, CovarianceForm::kJoseph, kTs);
  const Gain gain = f.initial_gain();
  EXPECT_EQ(gain.K.norm(), 0);
  EXPECT_EQ(gain.P(2, 2), 7);
  EXPECT_EQ(gain.k, -1);
}

TEST(EkfSensorless, AFlyingStartTakesTheKnownSpeed) {
  const EkfSensorless f(machine(), {}, Prediction::kEuler, CovarianceForm::kJoseph, kTs, 400);
  EXPECT_EQ(f.start({}).x_hat[2], 400);
}

TEST(EkfSensorless, AlignTakesTheAngleIntoATurnAndTheSpeedToZero) {
  const auto f = filter(Prediction::kEuler);
  FastState state;
  state.x_hat.head<4>() << 1, 2, 300, 3;
  f.align(state, -kPi / 2);
  EXPECT_NEAR(state.x_hat[3], 1.5 * kPi, 1e-15);
  EXPECT_EQ(state.x_hat[2], 0);
  EXPECT_EQ(state.x_hat[0], 1);
}

// The axes that a tick leaves behind change no bit of the next prediction, and none of an angle that
// was changed since.
TEST(EkfSensorless, TheOutputOfATickIsTheOutputAndTheNextStepIsThatOfAnyState) {
  const auto f = filter(Prediction::kEuler);
  const Gain gain = f.initial_gain();
  for (std::uint64_t i = 0; i < 200; ++i) {
    FastState state;
    state.x_hat.head<4>() = random_state(i);
    Estimate e{.status = 77, .T_load = 7, .dT_load_dt = 7};
    f.output_of_tick(state, {}, e);
    const Estimate plain = f.output(state, {});
    EXPECT_EQ(e.theta_e, plain.theta_e);
    EXPECT_EQ(e.omega_m, plain.omega_m);
    EXPECT_EQ(e.i_dq, plain.i_dq);
    EXPECT_EQ(e.i_dq, park(state.x_hat.head<2>(), state.x_hat[3]));
    EXPECT_EQ(std::tuple(e.n_x, e.n_y, e.status, e.T_load, e.dT_load_dt),
              std::tuple(4, 2, 0, 0, 0));
    for (const double turned : {0.0, 0.3}) {
      state.x_hat[3] += turned;
      FastState without = state;
      without.rotor_axes = {};
      const Measurement m{.u_alphabeta = random_voltage(i)};
      f.fast_step(state, m, gain);
      f.fast_step(without, m, gain);
      EXPECT_EQ(state.x_hat, without.x_hat);
    }
  }
}

TEST(EkfSensorless, OutputNamesTheStatesInMechanicalAndRotorTerms) {
  const auto f = filter(Prediction::kEuler);
  FastState state;
  state.x_hat.head<4>() << 0, 2, 400, kPi / 2;  // 2 A on beta, d on beta
  const Estimate e = f.output(state, {});
  EXPECT_NEAR(e.omega_m, 100, 1e-12);
  EXPECT_NEAR(e.i_dq[0], 2, 1e-12);
  EXPECT_NEAR(e.i_dq[1], 0, 1e-12);
  EXPECT_EQ(e.n_x, 4);
  EXPECT_EQ(e.n_y, 2);
}

}  // namespace
}  // namespace twinrate::ekf_sensorless_test
