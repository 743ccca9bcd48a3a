// The hand-written kernels against the same equations as matrices (tests/support/textbook_ekf.hpp).
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>

#include "estimator/kernels/ekf_dq_kernel.hpp"
#include "estimator/kernels/ekf_sensorless_kernel.hpp"
#include "estimator/kernels/ud_filter.hpp"
#include "model/discretise.hpp"
#include "model/frames.hpp"
#include "model/linear_algebra.hpp"
#include "model/random.hpp"
#include "tests/support/textbook_ekf.hpp"

namespace twinrate::kernels_test {
namespace {

using namespace kernel;
using test::TextbookDq;
using test::TextbookSensorless;
constexpr double kTs = 2e-4;

MachineParameters dilys() {
  return {.R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .B = 1e-5, .n_p = 4};
}
MachineParameters niewiara() {
  return {
      .R_s = 1.05, .L_d = 9.5e-3, .L_q = 11e-3, .psi_f = 0.2533, .J = 8.8e-3, .B = 3e-3, .n_p = 3};
}

Eigen::Matrix4d full(const Symmetric4<double>& P) {
  Eigen::Matrix4d M;
  M << P.m00, P.m01, P.m02, P.m03,  //
      P.m01, P.m11, P.m12, P.m13,   //
      P.m02, P.m12, P.m22, P.m23,   //
      P.m03, P.m13, P.m23, P.m33;
  return M;
}
Symmetric4<double> upper(const Eigen::MatrixXd& P) {
  return {P(0, 0), P(0, 1), P(0, 2), P(0, 3), P(1, 1), P(1, 2), P(1, 3), P(2, 2), P(2, 3), P(3, 3)};
}
Eigen::MatrixXd full(const Gain42<double>& K) {
  Eigen::MatrixXd M(4, 2);
  M << K.k00, K.k01, K.k10, K.k11, K.k20, K.k21, K.k30, K.k31;
  return M;
}
Eigen::MatrixXd full(const Gain43<double>& K) {
  Eigen::MatrixXd M(4, 3);
  M << K.k00, K.k01, K.k02, K.k10, K.k11, K.k12, K.k20, K.k21, K.k22, K.k30, K.k31, K.k32;
  return M;
}

// A covariance with every entry in use.
Eigen::Matrix4d random_covariance(std::uint64_t i) {
  Eigen::Matrix4d A;
  for (int e = 0; e < 16; ++e) A(e / 4, e % 4) = normal(11, static_cast<std::uint64_t>(e), i);
  return A * A.transpose() + 0.1 * Eigen::Matrix4d::Identity();
}
Eigen::Vector4d random_state(std::uint64_t i, double i_rms, double omega_rms) {
  return {i_rms * normal(12, 0, i), i_rms * normal(12, 1, i), omega_rms * normal(12, 2, i),
          kTwoPi * uniform(12, 6, i)};
}
double relative(const Eigen::MatrixXd& got, const Eigen::MatrixXd& expected) {
  return (got - expected).norm() / expected.norm();
}

TEST(SensorlessKernel, EveryFormIsTheTextbookStepOnFullCovariances) {
  const auto c = sensorless_euler(1.2, 5e-4, 0.007, kTs);
  const double Q[4] = {1, 2, 500, 0.1}, R[2] = {1, 3};
  for (std::uint64_t i = 0; i < 100; ++i) {
    TextbookSensorless<4, 2> oracle(dilys(), kTs);
    oracle.x = random_state(i, 2, 600);
    oracle.P = random_covariance(i);
    oracle.Q.diagonal() << 1, 2, 500, 0.1;
    oracle.R.diagonal() << 1, 3;
    const SensorlessState<double> x{oracle.x[0], oracle.x[1], oracle.x[2], oracle.x[3]};
    const UnitVector<double> at{std::sin(x.theta_e), std::cos(x.theta_e)};
    const Stationary<double> u{normal(13, 0, i), normal(13, 1, i)}, y{normal(13, 2, i), 0.5};
    const auto P_prior = propagate(c, jacobian(c, x.omega_e, at), upper(oracle.P), Q);
    const auto K = gain(P_prior, R);
    const auto one_by_one = sequential(P_prior, R);
    const auto x_prior = predict_euler(c, x, at, u);
    const auto corrected = correct(x_prior, K, innovation(x_prior, y));

    oracle.step(u.alpha, u.beta, Eigen::Vector2d(y.alpha, y.beta));
    ASSERT_LT(relative(full(K), oracle.K), 1e-12);
    ASSERT_LT(relative(full(one_by_one.K), oracle.K), 1e-12);
    ASSERT_LT(relative(full(posterior(P_prior, K, R)), oracle.P), 1e-12);
    ASSERT_LT(relative(full(posterior_joseph(P_prior, K, R)), oracle.P), 1e-12);
    ASSERT_LT(relative(full(one_by_one.P), oracle.P), 1e-12);
    ASSERT_LT(relative(Eigen::Vector4d(corrected.i_alpha, corrected.i_beta, corrected.omega_e,
                                       corrected.theta_e),
                       oracle.x),
              1e-12);
  }
}

TEST(SensorlessKernel, RungeKuttaIsTheClassicalStepOfTheSameEquations) {
  const auto c = sensorless_rk4(1.2, 5e-4, 0.007, kTs);
  const TextbookSensorless<4, 2> oracle(dilys(), kTs);
  for (std::uint64_t i = 0; i < 50; ++i) {
    const Eigen::Vector4d s = random_state(i, 2, 600);
    const Stationary<double> u{6 * normal(14, 0, i), 6 * normal(14, 1, i)};
    const auto at = [&](double share) {
      const double theta_e = s[3] + share * kTs * s[2];
      return UnitVector<double>{std::sin(theta_e), std::cos(theta_e)};
    };
    const auto x = predict_rk4(c, {s[0], s[1], s[2], s[3]}, at(0), at(0.5), at(1), u);
    const auto f = [&](const Eigen::Vector4d& z) { return oracle.f(z, u.alpha, u.beta); };
    const Eigen::Vector4d expected = rk4_step<Eigen::Vector4d>(f, s, kTs);
    ASSERT_LT((Eigen::Vector4d(x.i_alpha, x.i_beta, x.omega_e, x.theta_e) - expected).norm(),
              1e-12 * expected.norm());
  }
}

TEST(DqKernel, IsTheTextbookStepOnFullCovariances) {
  const MachineParameters m = niewiara();
  const double T = 1e-4;
  const auto c = dq_constants<double>(m.R_s, m.L_d, m.L_q, m.psi_f, m.J, m.n_p, 0, T);
  const double Q[4] = {1, 2, 1.5, 0.1}, R[3] = {10, 20, 150};
  for (std::uint64_t i = 0; i < 100; ++i) {
    TextbookDq<4, 3> oracle(m, T);
    oracle.x = random_state(i, 4, 30);
    oracle.P = random_covariance(i);
    oracle.Q.diagonal() << 1, 2, 1.5, 0.1;
    oracle.R.diagonal() << 10, 20, 150;
    const DqState<double> x{oracle.x[0], oracle.x[1], oracle.x[2], oracle.x[3]};
    const double u_d = normal(15, 0, i), u_q = 20 * normal(15, 1, i);
    const DqOutput<double> y{normal(15, 2, i), normal(15, 3, i), 20};
    const auto [K, P] = sequential(propagate(c, x, upper(oracle.P), Q), R);
    DqOutput<double> innov;
    const auto corrected = correct(c, predict_euler(c, x, u_d, u_q), K, y, innov);

    oracle.step(u_d, u_q, Eigen::Vector3d(y.i_d, y.i_q, y.omega_m));
    ASSERT_LT(relative(full(K), oracle.K), 1e-12);
    ASSERT_LT(relative(full(P), oracle.P), 1e-12);
    ASSERT_LT(
        relative(Eigen::Vector4d(corrected.i_d, corrected.i_q, corrected.omega_m, corrected.T_o),
                 oracle.x),
        1e-12);
  }
}

TEST(DqKernel, TheIntegralOfTheSpeedErrorMovesTheLoadTorqueAlone) {
  const MachineParameters m = niewiara();
  const auto plain = dq_constants<double>(m.R_s, m.L_d, m.L_q, m.psi_f, m.J, m.n_p, 0, 1e-4);
  const auto integral = dq_constants<double>(m.R_s, m.L_d, m.L_q, m.psi_f, m.J, m.n_p, -700, 1e-4);
  DqOutput<double> innov;
  const DqState<double> x{1, 2, 10, 0.5};
  const auto a = correct(plain, x, Gain43<double>{}, {1, 2, 11}, innov);
  const auto b = correct(integral, x, Gain43<double>{}, {1, 2, 11}, innov);
  EXPECT_EQ(a.omega_m, b.omega_m);
  EXPECT_NEAR(b.T_o - a.T_o, -700 * 1e-4 * 1, 1e-15);  // (25)
}

TEST(UdFilter, InDoubleIsTheSequentialUpdate) {
  const auto c = sensorless_euler(1.2, 5e-4, 0.007, kTs);
  const double Q[4] = {1, 2, 500, 0.1}, R[2] = {1, 3}, P0[4] = {1, 2, 3, 4};
  auto ud = ud_from_diagonal(P0);
  Symmetric4<double> P{1, 0, 0, 0, 2, 0, 0, 3, 0, 4};
  for (std::uint64_t i = 0; i < 200; ++i) {
    const Eigen::Vector4d s = random_state(i, 2, 600);
    const auto F = jacobian(c, s[2], UnitVector<double>{std::sin(s[3]), std::cos(s[3])});
    ud = ud_propagate(c, F, ud, Q);
    const auto K_ud = ud_gain(ud, R);
    const auto step = sequential(propagate(c, F, P, Q), R);
    P = step.P;
    Eigen::Matrix4d U = Eigen::Matrix4d::Identity();
    for (int row = 0; row < 4; ++row)
      for (int col = row + 1; col < 4; ++col) U(row, col) = ud.U[row][col];
    const Eigen::Matrix4d product = U * Eigen::Vector4d(ud.D).asDiagonal() * U.transpose();
    ASSERT_LT(relative(full(K_ud), full(step.K)), 1e-10);
    ASSERT_LT(relative(product, full(P)), 1e-10);
  }
}

// The filter in float on a machine at 400 rad/s: R far below P_0 leaves few digits for P.
struct FloatTuning {
  float R = 1e-4F, P0 = 100, Q_share = 1;  // Q_share: of (22)
  double i_noise = 0.01;
  std::array<float, 4> Q() const { return {Q_share, Q_share, 500 * Q_share, 0.1F * Q_share}; }
};
// Small process noise and low current noise: nothing compensates the rounding errors of P.
constexpr FloatTuning kSlow = {.Q_share = 1e-8F, .i_noise = 0.001};

UnitVector<float> unit(const SensorlessState<float>& x) {
  return {std::sin(x.theta_e), std::cos(x.theta_e)};
}

struct UdInFloat {
  explicit UdInFloat(const FloatTuning& tuning) {
    std::fill_n(P.D, 4, tuning.P0);
    std::copy_n(tuning.Q().data(), 4, Q);
    R[0] = R[1] = tuning.R;
  }
  UdCovariance<float> P = ud_from_diagonal({1.0F, 1.0F, 1.0F, 1.0F});
  float Q[4], R[2];
  Gain42<float> gain(const SensorlessConstants<float>& c, const SensorlessState<float>& x) {
    P = ud_propagate(c, jacobian(c, x.omega_e, unit(x)), P, Q);
    return ud_gain(P, R);
  }
  float smallest() const { return *std::min_element(P.D, P.D + 4); }
};

// The textbook matrices. `joseph`: (I - K H) P^- (I - K H)' + K R K', else (I - K H) P^-, which
// does not stay symmetric; K' = S^-1 (H P^-).
template <bool joseph>
struct MatricesInFloat {
  explicit MatricesInFloat(const FloatTuning& tuning)
      : P(tuning.P0 * Eigen::Matrix4f::Identity()),
        Q(Eigen::Vector4f(tuning.Q().data()).asDiagonal()),
        R(tuning.R * Eigen::Matrix2f::Identity()) {}
  Eigen::Matrix4f P, Q;
  Eigen::Matrix2f R;
  Gain42<float> gain(const SensorlessConstants<float>& c, const SensorlessState<float>& x) {
    const auto g = jacobian(c, x.omega_e, unit(x));
    Eigen::Matrix4f F;
    F << c.d, 0, g.g02, g.g03, 0, c.d, g.g12, g.g13, 0, 0, 1, 0, 0, 0, c.T_s, 1;
    const Eigen::Matrix4f P_prior = F * P * F.transpose() + Q;
    const Eigen::Matrix2f S = P_prior.topLeftCorner<2, 2>() + R;
    const Eigen::Matrix<float, 4, 2> K = S.ldlt().solve(P_prior.topRows<2>()).transpose();
    Eigen::Matrix4f I_KH = Eigen::Matrix4f::Identity();
    I_KH.leftCols<2>() -= K;
    P = joseph ? Eigen::Matrix4f(I_KH * P_prior * I_KH.transpose() + K * R * K.transpose())
               : Eigen::Matrix4f(I_KH * P_prior);
    return {K(0, 0), K(0, 1), K(1, 0), K(1, 1), K(2, 0), K(2, 1), K(3, 0), K(3, 1)};
  }
  float smallest() const {
    const Eigen::Matrix4d whole = P.cast<double>(), even = 0.5 * (whole + whole.transpose());
    return static_cast<float>(linear::symmetric_eigen(even).values[0]);
  }
};

struct FloatRun {
  double angle_error_max = 0;  // against the filter in double, second half
  float smallest = 1e9F;       // variance along the way
};

template <class Covariance>
FloatRun run_in_float(const FloatTuning& tuning) {
  const auto c = sensorless_euler(1.2, 5e-4, 0.007, kTs);
  const auto c_float = sensorless_euler(1.2F, 5e-4F, 0.007F, static_cast<float>(kTs));
  double Q[4];
  std::copy_n(tuning.Q().data(), 4, Q);
  const double R[2] = {tuning.R, tuning.R}, P0 = tuning.P0;
  SensorlessState<double> machine{0, 0, 400, 0.3}, x{0, 0, 380, 0};
  SensorlessState<float> x_float{0, 0, 380, 0};
  Symmetric4<double> P{P0, 0, 0, 0, P0, 0, 0, P0, 0, P0};
  Covariance in_float(tuning);
  FloatRun run;
  for (std::uint64_t k = 0; k < 4000; ++k) {
    const auto unit_of = [](double a) { return UnitVector<double>{std::sin(a), std::cos(a)}; };
    const UnitVector<double> at = unit_of(machine.theta_e);
    const Stationary<double> u{-3 * at.sin, 3 * at.cos};
    machine = predict_euler(c, machine, at, u);
    machine.theta_e = wrap_turn(machine.theta_e);
    const Stationary<double> y{machine.i_alpha + tuning.i_noise * normal(1, 0, k),
                               machine.i_beta + tuning.i_noise * normal(1, 1, k)};

    const UnitVector<double> at_x = unit_of(x.theta_e);
    const auto [K, P_new] = sequential(propagate(c, jacobian(c, x.omega_e, at_x), P, Q), R);
    P = P_new;
    const auto x_prior = predict_euler(c, x, at_x, u);
    x = correct(x_prior, K, innovation(x_prior, y));
    x.theta_e = wrap_turn(x.theta_e);

    const auto K_float = in_float.gain(c_float, x_float);
    const auto prior =
        predict_euler(c_float, x_float, unit(x_float),
                      Stationary<float>{static_cast<float>(u.alpha), static_cast<float>(u.beta)});
    x_float = correct(prior, K_float,
                      innovation(prior, {static_cast<float>(y.alpha), static_cast<float>(y.beta)}));
    x_float.theta_e = static_cast<float>(wrap_turn(x_float.theta_e));
    run.smallest = std::min(run.smallest, in_float.smallest());
    if (k >= 2000)
      run.angle_error_max =
          std::max(run.angle_error_max, std::abs(wrap_pi(x_float.theta_e - x.theta_e)));
  }
  return run;
}

// The variances are computed in double: a solver in float makes negative ones.
TEST(UdFilter, InFloatKeepsPositiveVariancesWhereThePaperFormInFloatDoesNot) {
  const FloatTuning exact{.R = 1e-8F};
  EXPECT_GT(run_in_float<UdInFloat>(exact).smallest, 0);
  EXPECT_GT(run_in_float<MatricesInFloat<true>>(exact).smallest, 0);
  EXPECT_LT(run_in_float<MatricesInFloat<false>>(exact).smallest, -1e-7);
  for (const FloatTuning& tuning : {FloatTuning{}, exact}) {
    const FloatRun run = run_in_float<UdInFloat>(tuning);
    EXPECT_LT(run.angle_error_max, 1e-5);
    EXPECT_GT(run.angle_error_max, 1e-8);  // it is float
  }
}

TEST(UdFilter, InFloatKeepsLockWhereThePaperFormInFloatLosesIt) {
  const FloatRun ud = run_in_float<UdInFloat>(kSlow);
  const FloatRun joseph = run_in_float<MatricesInFloat<true>>(kSlow);
  const FloatRun paper = run_in_float<MatricesInFloat<false>>(kSlow);
  EXPECT_GT(ud.smallest, 0);
  EXPECT_GT(joseph.smallest, 0);
  EXPECT_LT(paper.smallest, 0);
  EXPECT_LT(ud.angle_error_max, 1e-5);
  EXPECT_LT(joseph.angle_error_max, 1e-5);
  EXPECT_GT(paper.angle_error_max, kPi / 2);
}

}  // namespace
}  // namespace twinrate::kernels_test
