#include "controller/current_reference.hpp"

#include <gtest/gtest.h>

namespace twinrate {
namespace {

MachineParameters ipmsm() {
  return {.R_s = 11, .L_d = 0.05635, .L_q = 0.133, .psi_f = 0.285, .J = 1e-4, .B = 2e-4, .n_p = 2};
}

// Torque from the flux linkages, independent of the product.
double torque(const MachineParameters& m, const Vec2& i) {
  return 1.5 * m.n_p * ((m.psi_f + m.L_d * i[0]) * i[1] - m.L_q * i[1] * i[0]);
}

// Smallest current for a torque, by a scan over i_d.
double smallest_current(const MachineParameters& m, double T) {
  double best = 1e9;
  for (double i_d = -3; i_d <= 3; i_d += 1e-5) {
    const double per_i_q = torque(m, {i_d, 1});
    if (per_i_q <= 0) continue;
    best = std::min(best, std::hypot(i_d, T / per_i_q));
  }
  return best;
}

TEST(Mtpa, NeedsNoMoreCurrentThanAScanOverTheDCurrentFinds) {
  const MachineParameters m = ipmsm();
  MachineParameters reversed = m;  // L_d > L_q: the reluctance helps with a positive i_d
  std::swap(reversed.L_d, reversed.L_q);
  for (const MachineParameters& machine : {m, reversed})
    for (double I_s : {0.2, 0.8, 1.5, 2.447, 4.0}) {
      const Vec2 i = mtpa(machine, I_s);
      EXPECT_NEAR(i.norm(), I_s, 1e-12);
      EXPECT_NEAR(smallest_current(machine, torque(machine, i)), I_s, 1e-6 * I_s);
    }
}

TEST(Mtpa, RatedCurrentOfThePresetIsItsRatedTorque) {
  const Vec2 i = mtpa(ipmsm(), 1.73 * std::numbers::sqrt2);
  EXPECT_NEAR(i[0], -1.03, 0.01);
  EXPECT_NEAR(i[1], 2.22, 0.01);
  EXPECT_NEAR(torque(ipmsm(), i), 2.42, 0.01);
}

TEST(Mtpa, IsOddInItsAmplitudeAndHasNoDCurrentWithoutSaliency) {
  const Vec2 forward = mtpa(ipmsm(), 1.7), backward = mtpa(ipmsm(), -1.7);
  EXPECT_EQ(forward[0], backward[0]);
  EXPECT_EQ(forward[1], -backward[1]);
  MachineParameters round = ipmsm();
  round.L_q = round.L_d;
  EXPECT_EQ(mtpa(round, 1.7), Vec2(0, 1.7));
}

TEST(Mtpa, AmplitudeIsItsInverse) {
  for (double I_s : {-2.4, -0.3, 0.0, 0.7, 3.0})
    EXPECT_NEAR(mtpa_amplitude(ipmsm(), mtpa(ipmsm(), I_s)[1]), I_s, 1e-12);
}

TEST(LimitCurrent, GivesTheDCurrentPrecedenceAndTheFadeWhatIsLeft) {
  EXPECT_EQ(limit_current({-0.5, 1}, 0, 0, 2), Vec2(-0.5, 1));
  const Vec2 weakened = limit_current({-0.5, 5}, -1, 0, 2);
  EXPECT_NEAR(weakened[0], -1.5, 1e-12);
  EXPECT_NEAR(weakened.norm(), 2, 1e-12);
  const Vec2 faded = limit_current({-0.5, 1.9}, 0, 1.8, 2);
  EXPECT_NEAR(faded[1], 1.9, 1e-12);
  EXPECT_NEAR(faded.norm(), 2, 1e-12);
  EXPECT_EQ(limit_current({0, -9}, 0, 0, 2), Vec2(0, -2));
}

TEST(FieldWeakening, ActsOnlyAboveTheMarginAndStaysWithinTheCurrent) {
  FieldWeakening off({.active = false}, ipmsm(), 2.4, 1e-4),
      on({.active = true}, ipmsm(), 2.4, 1e-4);
  for (int k = 0; k < 1000; ++k) {
    off.update(300, 180, 600);
    on.update(150, 180, 600);
  }
  EXPECT_EQ(off.i_d(), 0);
  EXPECT_EQ(on.i_d(), 0);
  for (int k = 0; k < 10000; ++k) on.update(300, 180, 600);
  EXPECT_EQ(on.i_d(), -2.4);
  for (int k = 0; k < 10000; ++k) on.update(100, 180, 600);
  EXPECT_EQ(on.i_d(), 0);
}

TEST(FieldWeakening, BeginsAtItsShareOfTheVoltageNotAtTheLimit) {
  FieldWeakening weakening({.active = true, .margin = 0.9}, ipmsm(), 2.4, 1e-4);
  for (int k = 0; k < 10000; ++k) weakening.update(0.89 * 180, 180, 600);
  EXPECT_EQ(weakening.i_d(), 0);
  for (int k = 0; k < 10000; ++k) weakening.update(0.95 * 180, 180, 600);
  EXPECT_EQ(weakening.i_d(), -2.4);
}

}  // namespace
}  // namespace twinrate
