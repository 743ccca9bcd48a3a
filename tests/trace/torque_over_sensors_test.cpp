// A torque beyond the noise of the sensors, where that noise hides it.
#include "trace/torque_over_sensors.hpp"

#include <gtest/gtest.h>

#include "tests/trace/fitted_drive.hpp"

namespace twinrate {
namespace {

// Nm, of 0.3 to 7 Hz, as no effect of the catalogue has it.
double slow_torque(double t) {
  double sum = 0;
  for (int k = 0; k < 40; ++k) sum += std::sin((2 + 1.1 * k) * t + 7 * std::sin(3.0 * k));
  return 0.02 * sum;
}

struct Over {
  double raw, whitened;
};
Over over_sensors(const SyntheticDrive& drive) {
  const FittedDrive fitted(simulate_synthetic(drive), {});
  const Sampled left = fitted.chain().residual({});
  return {left.torque.norm() / left.noise_torque.norm(),
          torque_over_sensors(fitted.chain(), left, left.noise_torque)};
}

TEST(TorqueOverSensors, ShowsASlowTorqueThatTheNoiseOfTheAngleHides) {
  const Over none = over_sensors({.counts = 16384});
  EXPECT_NEAR(none.raw, 1, 0.2);
  EXPECT_NEAR(none.whitened, 1, 0.2);
  const Over slow = over_sensors(
      {.extra_load = [](double t, double, double) { return slow_torque(t); }, .counts = 16384});
  EXPECT_LT(slow.raw, 1.3);
  EXPECT_GT(slow.whitened, 2.5);
}

// 8 ms from row to row: the current follows the steps of the load in between, and the rows do not say when.
TEST(TorqueOverSensors, LeavesOutWhatRowsLeaveOpenBetweenThem) {
  const RawLog all = simulate_synthetic({});
  RawLog slow;
  for (std::size_t k = 0; k < all.size(); k += 80)
    for (const auto column :
         {&RawLog::t, &RawLog::i_a, &RawLog::i_b, &RawLog::i_c, &RawLog::theta_m, &RawLog::T_load})
      (slow.*column).push_back((all.*column)[k]);
  const FittedDrive fitted(slow, {});
  const Sampled left = fitted.chain().residual({});
  EXPECT_GT(left.torque.norm() / left.noise_torque.norm(), 5);
  EXPECT_LT(torque_over_sensors(fitted.chain(), left, left.noise_torque), 1);
}

// Noise of the angle moves the impacts of a gap, which nothing excuses without limit.
TEST(TorqueOverSensors, ImpactsAtOtherMomentsCountAsNoise) {
  const FittedDrive fitted(
      simulate_synthetic(
          {.extra_load = [](double t, double, double) { return slow_torque(t); }, .counts = 16384}),
      {});
  const Sampled left = fitted.chain().residual({});
  const auto over = [&](double times) {
    return torque_over_sensors(fitted.chain(), left, left.noise_torque, times * left.noise_torque);
  };
  EXPECT_NEAR(over(1), over(0) / std::sqrt(2.0), 1e-3);
  EXPECT_NEAR(over(100), over(0) / std::sqrt(1 + 9.0), 1e-3);
  EXPECT_EQ(fitted.chain().impacts_noise({make_effect("cogging")}).size(), 0);
  const auto gap = effect_with("backlash", {{"J_load_kgm2", 3e-3},
                                            {"gap_rad", 0.02},
                                            {"stiffness_Nm_rad", 600},
                                            {"damping_Nms_rad", 0.45}});
  const Eigen::VectorXd impacts = fitted.chain().impacts_noise({gap});
  EXPECT_GT(impacts.norm(), 0);
}

TEST(TorqueOverSensors, IsNoneWithoutNoise) {
  const FittedDrive fitted(simulate_synthetic({}), {});
  const Sampled left = fitted.chain().residual({});
  EXPECT_EQ(torque_over_sensors(fitted.chain(), left, {}), 0);
}

TraceResult traced_beside(double share) {
  Health health;
  const Record record = make_record(
      simulate_synthetic(
          {.extra_load = [=](double t, double, double) { return share * slow_torque(4 * t); },
           .counts = 2048}),
      servo().machine.n_p, health);
  return trace_record(record, servo(), health, {}, {});
}

// It is 5.6 times the noise there. No kind of the catalogue is named.
TEST(Tracer, ASlowTorqueThatItCannotNameIsUnexplained) {
  const TraceResult r = traced_beside(0.5);
  EXPECT_EQ(r.verdict, "unexplained") << r.sentence;
  EXPECT_NE(r.sentence.find("times that of white noise on the readings"), std::string::npos)
      << r.sentence;
  EXPECT_TRUE(r.effects.empty()) << r.sentence;
}

// 3 times the noise there: the drawn noise may be too quiet by less.
TEST(Tracer, ASmallerSlowTorqueIsADoubt) {
  const TraceResult r = traced_beside(0.25);
  EXPECT_EQ(r.verdict, "ambiguous") << r.sentence;
  EXPECT_NE(r.sentence.find("times that of white noise on the readings"), std::string::npos)
      << r.sentence;
}

}  // namespace
}  // namespace twinrate
