// The sensorless filter with the load as a state: its equations, its frame, and the speed below which
// it cannot know the load.
#include "estimator/ekf_joint.hpp"

#include <gtest/gtest.h>

#include "estimator/dq_ekf.hpp"
#include "estimator/ekf_sensorless.hpp"
#include "estimator/gain_frame.hpp"
#include "estimator/scaled_tuning.hpp"
#include "estimator/two_rate.hpp"
#include "model/linear_algebra.hpp"
#include "model/random.hpp"
#include "tests/support/drives.hpp"
#include "tests/support/matrices.hpp"

namespace twinrate::ekf_joint_test {
namespace {

constexpr double kTs = 1e-4;

MachineParameters salient() {
  return {.R_s = 1.1, .L_d = 5e-3, .L_q = 9e-3, .psi_f = 0.1, .J = 4e-4, .B = 0, .n_p = 3};
}
MachineParameters surface() {
  MachineParameters m = salient();
  m.L_d = m.L_q;
  return m;
}

template <int NX>
EkfJoint<NX> filter(const MachineParameters& m, Prediction prediction) {
  EkfJointParameters p;
  p.order = NX == 7 ? 6 : 0;
  return {m, p, prediction, CovarianceForm::kJoseph, kTs, {}};
}

template <int NX>
typename EkfJoint<NX>::State random_state(std::uint64_t i) {
  typename EkfJoint<NX>::State x;
  x.template head<5>() << 3 * normal(1, 0, i), 3 * normal(1, 1, i), 400 * normal(1, 2, i),
      kTwoPi * uniform(1, 6, i), normal(1, 3, i);
  if constexpr (NX == 7) x.template tail<2>() << normal(1, 4, i), normal(1, 5, i);
  return x;
}

template <int NX>
void expect_jacobian_of_the_euler_step(const MachineParameters& m) {
  const auto f = filter<NX>(m, Prediction::kEuler);
  Eigen::VectorXd step = Eigen::VectorXd::Constant(NX, 1e-4);
  step[2] = 1e-2;
  step[3] = 1e-5;
  for (std::uint64_t i = 0; i < 50; ++i) {
    const Eigen::VectorXd x = random_state<NX>(i);
    const Vec2 u(6 * normal(2, 0, i), 6 * normal(2, 1, i));
    const auto euler = [&](const Eigen::VectorXd& s) -> Eigen::VectorXd { return f.predict(s, u); };
    Eigen::MatrixXd difference =
        f.jacobian(x, park(u, x[3])) - test::numerical_jacobian(euler, x, step);
    if (NX == 7) {  // F takes the load of the pair at the snapshot, the step in mid-interval
      difference.row(2).tail(2).setZero();
      difference(2, 2) = 0;
    }
    EXPECT_LT(difference.cwiseAbs().maxCoeff(), 2e-6);
  }
}

TEST(EkfJoint, JacobianIsTheDerivativeOfTheEulerStep) {
  expect_jacobian_of_the_euler_step<5>(surface());
  expect_jacobian_of_the_euler_step<5>(salient());
  expect_jacobian_of_the_euler_step<7>(salient());
}

// A rotor that no torque accelerates: L_d = L_q leaves the model of ekf_sensorless.
TEST(EkfJoint, WithoutSaliencyAndWithAHeavyRotorItPredictsAsTheSensorlessFilter) {
  MachineParameters m = surface();
  m.J = 1e12;
  for (const Prediction prediction : {Prediction::kEuler, Prediction::kRk4, Prediction::kExact}) {
    const auto joint = filter<5>(m, prediction);
    const EkfSensorless sensorless(m, {}, prediction, CovarianceForm::kJoseph, kTs);
    for (std::uint64_t i = 0; i < 20; ++i) {
      const auto x = random_state<5>(i);
      const Vec2 u(6 * normal(2, 0, i), 6 * normal(2, 1, i));
      const Eigen::Vector4d difference =
          joint.predict(x, u).head<4>() - sensorless.predict(x.head<4>(), u);
      EXPECT_LT(difference.norm(), 1e-9);
    }
  }
}

// Oracle: the currents of a salient machine in rotor axes, in the filter that has them as states. A heavy
// rotor keeps its speed.
TEST(EkfJoint, WithSaliencyItPredictsTheCurrentsOfTheFilterInRotorAxes) {
  MachineParameters m = salient();
  m.J = 1e12;
  for (const Prediction prediction : {Prediction::kRk4, Prediction::kExact}) {
    const auto joint = filter<5>(m, prediction);
    const DqEkf rotor(m, {}, prediction, CovarianceForm::kJoseph, kTs, {});
    for (std::uint64_t i = 0; i < 20; ++i) {
      const auto x = random_state<5>(i);
      const Vec2 u(6 * normal(2, 0, i), 6 * normal(2, 1, i)), i_dq = park(x.head<2>(), x[3]);
      const Eigen::Vector4d there = rotor.predict({i_dq[0], i_dq[1], x[2], x[3]}, u);
      const Vec2 here = joint.predict(x, u).head<2>();
      EXPECT_LT((here - inverse_park(there.head<2>(), there[3])).norm(), 1e-5);
    }
  }
}

// Oracle: the textbook filter with matrices of any size and the equations in rotor axes.
TEST(EkfJoint, AtNOneItIsTheTextbookEkf) {
  using Eigen::MatrixXd;
  using Eigen::VectorXd;
  const MachineParameters m = salient();
  const auto f = std::make_shared<EkfJoint<5>>(filter<5>(m, Prediction::kEuler));
  FastLoop fast(f, GainPolicy::kPaper, 1);
  BackgroundLoop background(f, GainPolicy::kPaper, 1);
  VectorXd x = VectorXd::Zero(5);
  MatrixXd P = f->initial_gain().P.topLeftCorner<5, 5>();
  const EkfJointParameters p;
  const VectorXd Q = Eigen::Map<const VectorXd>(p.Q_diag, 5);
  const MatrixXd R = Eigen::Map<const VectorXd>(p.R_diag, 2).asDiagonal();
  const MatrixXd H = MatrixXd::Identity(2, 5);
  const auto next = [&](const VectorXd& s, const Vec2& u) -> VectorXd {
    const Vec2 i_dq = park(s.head<2>(), s[3]);
    const double psi_a = m.psi_f + (m.L_d - m.L_q) * i_dq[0];
    const Vec2 u_dq = park(u, s[3]);
    const Vec2 i_dq_rate((u_dq[0] - m.R_s * i_dq[0] + s[2] * m.L_q * i_dq[1]) / m.L_d,
                         (u_dq[1] - m.R_s * i_dq[1] - s[2] * (m.L_d * i_dq[0] + m.psi_f)) / m.L_q);
    // i = R(theta_e) i_dq
    const Vec2 rate = i_dq_rate + s[2] * Vec2(-i_dq[1], i_dq[0]);
    VectorXd y = s;
    y.head<2>() += kTs * inverse_park(rate, s[3]);
    y[2] += kTs * m.n_p / m.J * (1.5 * m.n_p * psi_a * i_dq[1] - s[4]);
    y[3] += kTs * s[2];
    return y;
  };
  Vec2 u_dq = Vec2::Zero();  // of the last period, in the axes of its middle: F has no later one
  const VectorXd step = (VectorXd(5) << 1e-4, 1e-4, 1e-2, 1e-5, 1e-4).finished();
  for (std::int64_t k = 0; k < 300; ++k) {
    const auto i = static_cast<std::uint64_t>(k);
    const double theta_e = 200 * kTs * static_cast<double>(k);
    Measurement s{.k = k};
    const Vec2 y = inverse_park({-0.4, 1.2}, theta_e) + 0.01 * Vec2(normal(4, 0, i), 0);
    s.i_abc = inverse_clarke(y);
    s.u_alphabeta = inverse_park({-3, 22}, theta_e - 100 * kTs);
    if (k == 0) {
      x.head<2>() = y;
    } else {
      const MatrixXd F = test::numerical_jacobian(
          [&](const VectorXd& at) { return next(at, inverse_park(u_dq, x[3])); }, x, step);
      const VectorXd x_prior = next(x, s.u_alphabeta);
      const MatrixXd P_prior = F * P * F.transpose() + MatrixXd(Q.asDiagonal());
      const MatrixXd K =
          linear::solve_symmetric(H * P_prior * H.transpose() + R, H * P_prior).transpose();
      u_dq = park(s.u_alphabeta, x_prior[3] - 0.5 * kTs * x_prior[2]);
      x = x_prior + K * (y - H * x_prior);
      P = (MatrixXd::Identity(5, 5) - K * H) * P_prior;
    }
    const Estimate e = fast.tick(s);
    fast.take_gain(background.step(e));
    ASSERT_LT((e.x_hat.head<3>() - x.head(3)).norm(), 1e-4 * (1 + x.head(3).norm())) << k;
    ASSERT_NEAR(wrap_pi(e.x_hat[3] - x[3]), 0, 1e-5) << k;
    ASSERT_NEAR(e.T_load, x[4], 1e-4) << k;
  }
  EXPECT_GT(std::abs(x[2]), 20) << "the run has a speed";
}

// The equations are the same at every rotor angle: so is the gain, turned.
TEST(EkfJoint, TheGainOfATurnedRotorIsTheTurnedGain) {
  const auto f = filter<7>(salient(), Prediction::kRk4);
  Estimate at = *f.steady_state(60);
  at.x_hat.head<2>() = Vec2(-1.2, 2.1);
  at.x_hat[4] = 0.3;
  const Estimate turned_at = turned(at, 1, 0.9);
  Estimate there = turned_at;
  there.x_hat[3] = turned_at.theta_e;
  Gain here = f.background_step(f.initial_gain(), at);
  here = f.background_step(here, at);
  Gain other = f.background_step(f.initial_gain(), there);
  other = f.background_step(other, there);
  GainFrame(1, 0.9).turn_gain(here);
  EXPECT_LT((here.K - other.K).norm(), 1e-9 * other.K.norm());
}

TEST(EkfJoint, TheRateOfTheLoadIsThatOfItsHarmonic) {
  const auto f = filter<7>(surface(), Prediction::kRk4);
  FastState state;
  state.x_hat.head<7>() << 0, 0, 60, 0, 0.2, 0.1, -0.3;
  const Estimate now = f.output(state, {});
  const Estimate later = f.ahead(f.estimate_of(state, {}), 1);
  EXPECT_NEAR(now.T_load, 0.3, 1e-12);
  EXPECT_NEAR((later.x_hat[5] - 0.1) / kTs, now.dT_load_dt, 0.01 * std::abs(now.dT_load_dt));
}

std::shared_ptr<const Filter> sensorless_niewiara(double Q_theta, double omega_e = 0) {
  const Config config = test::load("niewiara2020");
  const MachineParameters m = config.drive().machine;
  EkfJointParameters p;
  scale(p, per_unit(m, config.drive().inverter.v_dc, kTs), m.J, kTs);
  if (Q_theta > 0) p.Q_diag[3] = Q_theta;
  return EkfJointKind::make(m, p, Prediction::kExact, CovarianceForm::kJoseph, kTs, {0, omega_e});
}

// The motor of niewiara2020 turns steadily while a load drives or brakes it; the filter does not know
// of `u_unknown`, against the EMF, and starts at the truth. Returns the largest error of the load in the
// second half of a second, relative to the load.
double load_error(double Q_theta, double omega_e, double i_q, double u_unknown) {
  const MachineParameters m = test::drive_of("niewiara2020").machine;
  const auto f = sensorless_niewiara(Q_theta, omega_e);
  FastLoop fast(f, GainPolicy::kPaper, 1);
  BackgroundLoop background(f, GainPolicy::kPaper, 1);
  const Vec2 i_dq(0, i_q);
  const double load = m.torque(0, i_q);
  const Vec2 u_dq(-omega_e * m.L_q * i_q, m.R_s * i_q + omega_e * m.psi_f - u_unknown);
  double worst = 0;
  for (std::int64_t k = 0; k < 10000; ++k) {
    const double theta_e = omega_e * kTs * static_cast<double>(k);
    Measurement s{.k = k, .signals = kPhaseCurrents | kVoltage};
    s.i_abc = inverse_clarke(inverse_park(i_dq, theta_e));
    s.u_alphabeta = inverse_park(u_dq, theta_e - 0.5 * omega_e * kTs);
    const Estimate e = fast.tick(s);
    fast.take_gain(background.step(e));
    if (k > 5000) worst = std::max(worst, std::abs(e.T_load / load - 1));
  }
  return worst;
}

TEST(EkfJoint, KnowsTheLoadOfAKnownVoltageWithItsSign) {
  EXPECT_LT(load_error(0, 30, 5, 0), 0.01);
  EXPECT_LT(load_error(0, 30, -5, 0), 0.01);
  EXPECT_LT(load_error(0, -30, 5, 0), 0.01);
}

// 1.5 V are R_s 20 % wrong at rated current. Two tunings: the limit is that of the filter.
TEST(EkfJoint, BelowItsSpeedLimitTheLoadIsNotObservable) {
  const MachineParameters m = test::drive_of("niewiara2020").machine;
  const double u_unknown = 1.5;
  for (const double Q_theta : {1e-4, 1e-6}) {
    const double limit = *sensorless_niewiara(Q_theta)->load_speed_min(u_unknown);
    EXPECT_GT(limit, u_unknown / m.psi_f);
    for (const double i_q : {5.0, -5.0}) {
      EXPECT_LT(load_error(Q_theta, 1.25 * limit, i_q, u_unknown), 0.2) << Q_theta << " " << i_q;
      EXPECT_GT(load_error(Q_theta, 0.9 * limit, i_q, u_unknown), 0.5) << Q_theta << " " << i_q;
    }
  }
}

}  // namespace
}  // namespace twinrate::ekf_joint_test
