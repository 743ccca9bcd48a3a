#include "controller/pi.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

TEST(Pi, AConstantErrorGivesAStepAndARamp) {
  Pi pi({.K_p = 2, .K_i = 30, .k_awu = 5});
  for (int k = 0; k < 100; ++k) {
    const double u = pi.output(0.5);
    EXPECT_NEAR(u, 2 * 0.5 + 30 * 0.5 * k * 1e-3, 1e-12);
    pi.update(0.5, u, u, 1e-3);
  }
}

TEST(Pi, APositiveErrorRaisesTheOutput) {
  Pi pi({.K_p = 1, .K_i = 1, .k_awu = 1});
  EXPECT_GT(pi.output(1), 0);
  pi.update(1, 1, 1, 0.1);
  EXPECT_GT(pi.integral(), 0);
}

TEST(CurrentPi, CancelsTheWindingsPoleAndLeavesOneOfItsBandwidth) {
  // R i + L i' = u under current_pi: i = 1 - exp(-omega t), with fine steps.
  const double R_s = 1.2, L = 5e-4, omega = 2000, h = 1e-8;
  Pi pi(current_pi(omega, R_s, L));
  double i = 0, worst = 0;
  for (int k = 0; k < 200000; ++k) {
    worst = std::max(worst, std::abs(i - (1 - std::exp(-omega * h * k))));
    const double u = pi.output(1 - i);
    pi.update(1 - i, u, u, h);
    i += h / L * (u - R_s * i);
  }
  EXPECT_LT(worst, 1e-4);
  EXPECT_GT(i, 0.97);
}

TEST(SpeedPi, CrossesOverAtItsBandwidth) {
  // Loop K_t/(J s) (K_p + K_i/s): gain 1 near omega, with the integral a tenth of it slower.
  const double J = 1e-5, K_t = 0.042, omega = 50;
  const PiGains g = speed_pi(omega, J, K_t);
  const double gain = K_t / (J * omega) * std::hypot(g.K_p, g.K_i / omega);
  EXPECT_NEAR(gain, std::sqrt(1.01), 1e-12);
  EXPECT_NEAR(g.K_i / g.K_p, 0.1 * omega, 1e-12);
}

TEST(AntiWindup, SettlesTheExcessOutputAtKiErrorOverKawu) {
  Pi pi({.K_p = 2, .K_i = 30, .k_awu = 50});
  double u = 0;
  for (int k = 0; k < 20000; ++k) {
    u = pi.output(1);
    pi.update(1, u, std::clamp(u, -1.0, 1.0), 1e-4);
  }
  EXPECT_NEAR(u, 1 + 30.0 / 50, 1e-6);
}

TEST(AntiWindup, LeavesTheLimitOnceTheErrorTurns) {
  const auto ticks_at_the_limit = [](double k_awu) {
    Pi pi({.K_p = 2, .K_i = 30, .k_awu = k_awu});
    const auto step = [&](double error) {
      const double u = pi.output(error), limited = std::clamp(u, -1.0, 1.0);
      pi.update(error, u, limited, 1e-3);
      return u > 1;
    };
    for (int k = 0; k < 1000; ++k) step(1);
    int ticks = 0;
    while (step(-0.1) && ticks < 20000) ++ticks;
    return ticks;
  };
  EXPECT_LT(ticks_at_the_limit(50), 5);
  EXPECT_GT(ticks_at_the_limit(0), 5000);  // without anti-windup
}

TEST(Pi, PresetIsTheOutputAtZeroError) {
  Pi pi({.K_p = 2, .K_i = 30, .k_awu = 5});
  pi.preset(0.75);
  EXPECT_EQ(pi.output(0), 0.75);
}

}  // namespace
}  // namespace twinrate
