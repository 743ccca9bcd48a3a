// The fixed-point filter of the Cortex-M3: against the double-precision filter, in closed loops, with
// every operation checked.
#include <gtest/gtest.h>

#include "analysis/summary.hpp"
#include "embedded/closed_run.hpp"
#include "embedded/fixed_estimator.hpp"
#include "estimator/kernels/ekf_sensorless_kernel.hpp"
#include "loop/load_drive.hpp"
#include "model/linear_algebra.hpp"

namespace twinrate::fixed_filter_test {
namespace {

constexpr double kDegree = kTwoPi / 360;

Config drive_with(const std::vector<std::string>& overrides) {
  return load_drive("dilys2021", overrides);
}

template <class Estimator>
RunLog run(Config& config, Estimator& estimator) {
  return closed_run(config, [&](const Measurement& m) { return estimator.tick(m); });
}

bool locked(const RunLog& log, const Config& config) {
  return summarise(log, config.drive()).locked.value_or(false);
}

TEST(Sine, IsWithinItsErrorAtEveryAngle) {
  double worst = 0;
  for (std::uint64_t raw = 0; raw < 1ull << 32; raw += 65521) {
    const auto theta = static_cast<std::uint32_t>(raw);
    const auto at = m3::unit_vector<m3::Checked32>(theta);
    const double angle = m3::angle_of(theta);
    worst = std::max(worst, std::abs(std::ldexp(at.sin.value(), -31) - std::sin(angle)));
    worst = std::max(worst, std::abs(std::ldexp(at.cos.value(), -31) - std::cos(angle)));
  }
  EXPECT_LT(worst, 1.4e-6);
  EXPECT_GT(worst, 1e-7);
}

TEST(Reciprocal, IsExactTo27Bits) {
  for (std::int64_t d = 1 << 30; d < 1ll << 31; d += 99991) {
    const double r = m3::reciprocal<m3::Checked32>(static_cast<int>(d)).value();
    EXPECT_NEAR(r * static_cast<double>(d) / 0x1p60, 1, 0x1p-27) << d;
  }
}

TEST(CheckedNumber, StopsAtTheFirstWrap) {
  using Word = m3::Checked32::Word;
  EXPECT_EQ((Word(0x7ffffffe) + Word(1)).value(), 0x7fffffff);
  EXPECT_THROW(Word(0x7fffffff) + Word(1), m3::Wrapped);
  EXPECT_THROW(-Word(INT32_MIN), m3::Wrapped);
  EXPECT_THROW(m3::Checked32::shifted_left(Word(1 << 20), 11), m3::Wrapped);
  EXPECT_THROW(m3::Checked32::narrow<8>(m3::Checked32::product(Word(1 << 20), Word(1 << 20))),
               m3::Wrapped);
  EXPECT_THROW(m3::Checked16::cell(m3::Checked16::Word(32768)), m3::Wrapped);
}

// The bounds of formats.hpp hold for the machine of the preset, and fail where a clamp is so wide that
// its quantity would not fit.
TEST(Ranges, HoldForThePresetAndRefuseAnother) {
  Config config = drive_with({});
  m3::Machine machine = fixed_machine(config);
  EXPECT_EQ(m3::check_ranges<m3::Format32>(machine).first_that_fails(), nullptr);
  machine.P44_max = 10;
  ASSERT_NE(m3::check_ranges<m3::Format32>(machine).first_that_fails(), nullptr);
  EXPECT_STREQ(m3::check_ranges<m3::Format32>(machine).first_that_fails()->quantity, "P^-_33");
  Config fast = drive_with({"machine.R_s_Ohm=1.3"});
  EXPECT_THROW(fixed_settings(fast), BadInput);
}

// The filter in double precision, n = 1, with the clamps of the firmware on P33, P34 and P44.
class ClampedDouble {
 public:
  explicit ClampedDouble(const m3::Machine& m)
      : m_(m), c_(kernel::sensorless_euler(m.R_s, m.L, m.psi_f, m.T_s)) {
    P_.m00 = m.P0_diag[0], P_.m11 = m.P0_diag[1], P_.m22 = m.P0_diag[2], P_.m33 = m.P0_diag[3];
  }
  Estimate tick(const Measurement& m) {
    const Vec2 y = clarke(m.i_abc);
    if (m.k == 0) {
      x_ = {y[0], y[1], 0, 0};
    } else {
      const auto prior = predict_euler(c_, x_, at(), {m.u_alphabeta[0], m.u_alphabeta[1]});
      x_ = correct(prior, K_, innovation(prior, {y[0], y[1]}));
    }
    const auto P_prior = propagate(c_, jacobian(c_, x_.omega_e, at()), P_, m_.Q_diag);
    K_ = kernel::gain(P_prior, m_.R_diag);
    P_ = posterior(P_prior, K_, m_.R_diag);
    P_.m22 = std::min(P_.m22, m_.P33_max);
    P_.m23 = std::clamp(P_.m23, -m_.P34_max, m_.P34_max);
    P_.m33 = std::min(P_.m33, m_.P44_max);
    Estimate e;
    e.theta_e = x_.theta_e;
    e.x_hat[2] = x_.omega_e;
    return e;
  }

 private:
  kernel::UnitVector<double> at() const { return {std::sin(x_.theta_e), std::cos(x_.theta_e)}; }
  m3::Machine m_;
  kernel::SensorlessConstants<double> c_;
  kernel::SensorlessState<double> x_{};
  kernel::Symmetric4<double> P_{};
  kernel::Gain42<double> K_{};
};

// Largest difference of the angle over the ticks in which the reference runs at `omega_e` or faster.
double largest_above(double omega_e, const RunLog& log, const std::vector<Estimate>& expected) {
  double largest = 0;
  for (std::size_t k = 0; k < expected.size(); ++k)
    if (std::abs(expected[k].x_hat[2]) >= omega_e)
      largest = std::max(largest, std::abs(wrap_pi(log.estimate[k].theta_e - expected[k].theta_e)));
  return largest;
}

// 10 s from standstill to 1200 rad/s and back; every operation is checked.
constexpr const char* kProfile =
    "reference.omega_e_rad_s=[[0,0],[0.5,300],[2,600],[3.5,1200],[6,600],[7.5,300],[8.5,0]]";

TEST(FixedPoint, FollowsTheDoubleFilterOverAProfileToTwelveHundred) {
  Config config = drive_with({kProfile, "rates.n=1", "run.duration_s=10"});
  FixedChecked32 fixed(config);
  const RunLog log = run(config, fixed);
  ASSERT_TRUE(locked(log, config));
  ClampedDouble clamped(fixed_machine(config));
  std::vector<Estimate> expected;
  for (const Measurement& m : log.measurement) expected.push_back(clamped.tick(m));
  EXPECT_LT(largest_above(0, log, expected), 0.05 * kDegree);
  EXPECT_GT(largest_above(0, log, expected), 0);
  // Without the clamps the variance of an angle that cannot be observed grows without bound: at
  // standstill the estimates differ by what the clamp of P44 changes.
  const auto unclamped = double_estimates(config, log);
  EXPECT_LT(largest_above(100, log, unclamped), 0.1 * kDegree);
  EXPECT_GT(fixed.filter().clamps().P44, 1000u);
  EXPECT_EQ(fixed.filter().clamps().P33, 0u);
  EXPECT_EQ(fixed.filter().clamps().P34, 0u);
  EXPECT_EQ(fixed.filter().clamps().omega, 0u);
  RecordProperty("deg_clamped", std::to_string(largest_above(0, log, expected) / kDegree));
  RecordProperty("deg_above_100", std::to_string(largest_above(100, log, unclamped) / kDegree));
  RecordProperty("deg_all", std::to_string(largest_above(0, log, unclamped) / kDegree));
}

// Ten seconds at standstill, with the noise of the sensors; `cortex_m3 standstill` runs the hour.
TEST(FixedPoint, DoesNotWrapAtStandstill) {
  Config config = drive_with({"reference.omega_e_rad_s=0", "rates.n=1", "run.duration_s=10"});
  FixedChecked32 fixed(config);
  run(config, fixed);
  const auto P = fixed.filter().covariance();
  EXPECT_GT(fixed.filter().clamps().P44, 40000u);
  Eigen::Matrix4d full;
  const auto at = [](auto cell) { return std::ldexp(cell.value(), -m3::Format32::kP); };
  full << at(P.m00), at(P.m01), at(P.m02), at(P.m03), at(P.m01), at(P.m11), at(P.m12), at(P.m13),
      at(P.m02), at(P.m12), at(P.m22), at(P.m23), at(P.m03), at(P.m13), at(P.m23), at(P.m33);
  EXPECT_GT(linear::symmetric_eigen(full).values[0], 0);
}

TEST(FixedPoint, HasTheLimitOfTheDoubleFilter) {
  for (const int n : {1, 2, 5, 11, 12, 13}) {
    Config config = drive_with({"rates.n=" + std::to_string(n), "run.duration_s=1.5"});
    FixedChecked32 fixed(config);
    EXPECT_EQ(locked(run(config, fixed), config), n < 13) << n;
  }
}

// Policy scheduled: no background, the steady gain of a table.
TEST(FixedPoint, RunsOnTheTableOfGains) {
  Config config = drive_with({"gain.policy=scheduled", "run.duration_s=1.5"});
  FixedChecked32 fixed(config);
  const RunLog log = run(config, fixed);
  ASSERT_TRUE(locked(log, config));
  EXPECT_LT(largest_angle_difference(log.estimate, double_estimates(config, log), 5000),
            0.05 * kDegree);
  Config back =
      drive_with({"gain.policy=scheduled", "run.duration_s=1.5", "reference.omega_e_rad_s=-400"});
  FixedChecked32 backwards(back);
  const RunLog log_back = run(back, backwards);
  ASSERT_TRUE(locked(log_back, back));
  EXPECT_LT(largest_angle_difference(log_back.estimate, double_estimates(back, log_back), 5000),
            0.05 * kDegree);
}

// Switched on at speed, a gain every hundredth tick that is turned with the rotor holds the drive.
TEST(FixedPoint, RotatesAGainOfOneHundredTicks) {
  Config config =
      drive_with({"gain.policy=rotate", "rates.n=100", "rates.n_from_s=0.5", "run.duration_s=2"});
  FixedChecked32 fixed(config);
  const RunLog log = run(config, fixed);
  ASSERT_TRUE(locked(log, config));
  EXPECT_LT(largest_angle_difference(log.estimate, double_estimates(config, log), 5000),
            0.05 * kDegree);
}

// 16-bit covariance and gain: locked too, and further from the double filter.
TEST(FixedPoint, SixteenBitsKeepSynchronismAtFourHundred) {
  Config config = drive_with({"rates.n=5", "run.duration_s=1.5"});
  FixedChecked16 fixed(config);
  const RunLog log = run(config, fixed);
  ASSERT_TRUE(locked(log, config));
  const double largest =
      largest_angle_difference(log.estimate, double_estimates(config, log), 5000);
  EXPECT_LT(largest, 0.05 * kDegree);
  EXPECT_GT(largest, 1e-4 * kDegree);
}

}  // namespace
}  // namespace twinrate::fixed_filter_test
