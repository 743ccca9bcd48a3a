// The current that the limit leaves, by a fine integration of the machine's equations.
#include "safety/current_limit.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace twinrate {
namespace {

constexpr CurrentLimit kLimit{.T_s = 2e-5, .R_s = 0.5, .L_d = 2e-3, .L_q = 5e-3, .psi_f = 0.05};

// L_d di_d/dt = u_d - R_s i_d + omega_e L_q i_q
// L_q di_q/dt = u_q - R_s i_q - omega_e (L_d i_d + psi_f)
CurrentLimit::Dq after_interval(const CurrentLimit::Dq& u, CurrentLimit::Dq i, double omega_e) {
  constexpr int kSteps = 1000;
  for (int s = 0; s < kSteps; ++s) {
    const double d = (u[0] - kLimit.R_s * i[0] + omega_e * kLimit.L_q * i[1]) / kLimit.L_d;
    const double q =
        (u[1] - kLimit.R_s * i[1] - omega_e * (kLimit.L_d * i[0] + kLimit.psi_f)) / kLimit.L_q;
    i[0] += kLimit.T_s / kSteps * d;
    i[1] += kLimit.T_s / kSteps * q;
  }
  return i;
}

TEST(CurrentLimit, TheVoltageLeavesTheCurrentOnTheLimit) {
  for (const double omega_e : {-900.0, 0.0, 900.0})
    for (const CurrentLimit::Dq u : {CurrentLimit::Dq{600, 800}, {-900, 200}, {-1500, -2000}}) {
      const CurrentLimit::Dq i = {-2, 4};
      const CurrentLimit::Dq limited = kLimit.limited(u, i, omega_e, 5);
      const CurrentLimit::Dq end = after_interval(limited, i, omega_e);
      // One step of Euler: the coupling over the interval is off by omega_e T_s/2 L_q/L_d = 0.02 of the change.
      EXPECT_NEAR(std::hypot(end[0], end[1]), 5, 0.15) << omega_e << " rad/s";
    }
}

TEST(CurrentLimit, BelowTheLimitTheVoltageStays) {
  const CurrentLimit::Dq u = {1, 40};
  EXPECT_EQ(kLimit.limited(u, {-1, 2}, 300, 5), u);
}

}  // namespace
}  // namespace twinrate
