// Known effects against closed forms at hand-placed samples.
#include "estimator/known_effects.hpp"

#include <gtest/gtest.h>

#include "model/frames.hpp"
#include "tests/support/effects.hpp"

namespace twinrate {
namespace {

// The voltage of a row acted from t_{k-1} to t_k. A magnet flux of A cos(N theta_m + phase) along d
// takes [d/dt, omega_e] of it, at the angle in the middle of that interval.
TEST(KnownEffectsOfTheVoltage, AreThoseOfTheMiddleOfTheInterval) {
  constexpr double A = 2e-3, N = 18, phase = 0.4, T_s = 1e-4, theta_before = 0.7;
  const DriveFacts facts = test::drive_facts();
  const KnownEffects known(
      {test::effect_of("flux_harmonics",
                       {{"order", N}, {"amplitude_Wb", A}, {"phase_rad", phase}})},
      facts.machine, 3, T_s);
  for (const double omega_m : {100.0, -60.0}) {
    const double theta_mid = theta_before + 0.5 * T_s * omega_m;
    Estimate last;
    last.k = 9;
    last.omega_m = omega_m;
    last.theta_e = facts.machine.n_p * theta_before;
    Measurement before, m;
    before.k = 9;
    m.k = 10;
    m.signals = kPhaseCurrents | kVoltage | kPosition;
    m.theta_m = theta_before + T_s * omega_m;
    m.u_alphabeta = {3, -5};
    const double turn = N * theta_mid + phase;
    const Vec2 lost_dq(-A * N * omega_m * std::sin(turn),
                       facts.machine.n_p * omega_m * A * std::cos(turn));
    const Vec2 expected = m.u_alphabeta - inverse_park(lost_dq, facts.machine.n_p * theta_mid);
    EXPECT_LT((known.seen(m, last, before).u_alphabeta - expected).norm(), 1e-9) << omega_m;
    EXPECT_GT(lost_dq.norm(), 0.1);
  }
}

}  // namespace
}  // namespace twinrate
