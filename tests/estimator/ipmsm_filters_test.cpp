// The filters of the salient machine: Jacobians against central differences, predictions against
// the plant's equations, start, and samples that are not finite.
#include "tests/estimator/ipmsm_filters.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "estimator/active_flux.hpp"
#include "plant_sim/integrator.hpp"
#include "tests/support/matrices.hpp"

namespace twinrate::ipmsm_filters_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using test::numerical_jacobian;

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

// One period of the plant at constant speed, from random operating points.
struct Period {
  PlantState before, after;
  Vec2 u_alphabeta;
};

Period period_of(std::uint64_t k, Saliency saliency, double omega_m) {
  MachineParameters m = ipmsm();
  m.J = 1e6;  // constant speed
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

TEST(AllFourFilters, KeepTheirPredictionAndReportASampleThatIsNotFinite) {
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
