#include "analysis/step_response.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

namespace twinrate {
namespace {

constexpr double kT_s = 1e-4;

DriveConfig drive(std::vector<ProfileStep> omega_e, std::vector<ProfileStep> load) {
  DriveConfig config;
  config.machine.n_p = 2;
  config.reference.omega_e_rad_s = Profile(std::move(omega_e));
  config.load.T_load_Nm = Profile(std::move(load));
  return config;
}

// The answers of a drive that turns with omega_m(t) for two seconds, its first tick at 5 s.
std::vector<StepResponse> answers(const DriveConfig& config,
                                  const std::function<double(double)>& omega_m) {
  std::vector<TickRow> rows;
  std::vector<double> speeds;
  for (int k = 0; k < 20000; ++k) {
    rows.push_back({.k = k, .t_s = 5 + k * kT_s});
    speeds.push_back(omega_m(k * kT_s));
  }
  return step_responses(rows, speeds, config);
}

// A second-order system with damping zeta and omega_0: overshoot exp(-pi zeta/sqrt(1 - zeta^2)).
TEST(StepResponse, OfASecondOrderSystemIsThatOfTheTextbook) {
  constexpr double kZeta = 0.5, kOmega0 = 60, kFrom_s = 0.25;
  const double w = kOmega0 * std::sqrt(1 - kZeta * kZeta);
  const auto steps = answers(drive({{0, 0}, {kFrom_s, -200}}, {{0, 0}}), [&](double t_s) {
    const double t = std::max(0.0, t_s - kFrom_s);
    return -100 * (1 - std::exp(-kZeta * kOmega0 * t) *
                           (std::cos(w * t) + kZeta * kOmega0 / w * std::sin(w * t)));
  });
  ASSERT_EQ(steps.size(), 1u);
  const StepResponse& s = steps[0];
  EXPECT_FALSE(s.of_load);
  EXPECT_DOUBLE_EQ(s.t_s, kFrom_s);
  EXPECT_DOUBLE_EQ(s.to, -100);
  EXPECT_NEAR(s.overshoot.value(), 100 * std::exp(-kPi * kZeta / std::sqrt(1 - kZeta * kZeta)),
              0.01);
  EXPECT_NEAR(s.rise_s.value() * kOmega0, 1.639, 0.015);  // tables of the step response at zeta 0.5
  EXPECT_NEAR(s.recovery_s.value() * kOmega0, 8.08, 0.05);  // the 2 % band
  EXPECT_FALSE(s.dip);
}

// A dip D t/tau exp(1 - t/tau) is largest, D, at tau, and falls to a tenth at 4.890 tau.
TEST(StepResponse, OfALoadHasItsDipAndItsRecovery) {
  constexpr double kTau = 0.02, kStep_s = 1, kDip = 7;
  for (const double direction : {1.0, -1.0}) {
    const auto steps =
        answers(drive({{0, direction * 200}}, {{0, 0}, {kStep_s, 0.4}}), [&](double t_s) {
          const double t = std::max(0.0, t_s - kStep_s) / kTau;
          return direction * (100 - kDip * t * std::exp(1 - t));
        });
    ASSERT_EQ(steps.size(), 1u) << "it turns with the first speed from the first tick";
    EXPECT_TRUE(steps[0].of_load);
    EXPECT_NEAR(steps[0].dip.value(), kDip, 1e-3);
    EXPECT_NEAR(steps[0].overshoot.value(), 0, 1e-9);
    EXPECT_NEAR(steps[0].recovery_s.value(), 4.890 * kTau, 2e-4);
    EXPECT_FALSE(steps[0].rise_s);
    EXPECT_DOUBLE_EQ(steps[0].reference, direction * 100);
  }
}

// The speed never comes to the second reference, and stays away from the first after the load.
TEST(StepResponse, WithoutAnEndHasNoTime) {
  const auto steps = answers(drive({{0, 200}, {1.5, 400}}, {{0, 0}, {1, 0.4}}), [](double t_s) {
    return t_s < 1 ? 100.0 : t_s < 1.5 ? 90.0 : 120.0;
  });
  ASSERT_EQ(steps.size(), 2u);
  EXPECT_NEAR(steps[0].dip.value(), 10, 1e-9);
  EXPECT_FALSE(steps[0].recovery_s);
  EXPECT_FALSE(steps[1].rise_s);
  EXPECT_FALSE(steps[1].overshoot);
  EXPECT_FALSE(steps[1].recovery_s);
}

}  // namespace
}  // namespace twinrate
