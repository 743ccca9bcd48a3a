#include "model/machine.hpp"

#include <gtest/gtest.h>

namespace twinrate {
namespace {

TEST(Torque, IsThePowerThatTheBackEmfTakesOverTheSpeed) {
  // P = 3/2 (e_d i_d + e_q i_q) with e_d = -omega_e L_q i_q, e_q = omega_e (L_d i_d + psi_f).
  MachineParameters m{.L_d = 4e-3, .L_q = 9e-3, .psi_f = 0.285, .n_p = 3};
  const double omega_m = 47, omega_e = 3 * omega_m;
  for (double i_d : {-4.0, 0.0, 2.5}) {
    for (double i_q : {-6.0, 1.0, 3.0}) {
      const double e_d = -omega_e * m.L_q * i_q, e_q = omega_e * (m.L_d * i_d + m.psi_f);
      EXPECT_NEAR(m.torque(i_d, i_q), 1.5 * (e_d * i_d + e_q * i_q) / omega_m, 1e-12);
    }
  }
}

TEST(Torque, TheDilysMotorGives42MilliNewtonmetresAnAmpere) {
  const MachineParameters m{.L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .n_p = 4};
  EXPECT_NEAR(m.torque_constant(), 0.042, 1e-15);
  EXPECT_NEAR(m.torque(3, 1), 0.042, 1e-15);  // no reluctance torque without saliency
}

TEST(Torque, NegativeDCurrentHelpsWhereLqIsLarger) {
  const MachineParameters m{.L_d = 4e-3, .L_q = 9e-3, .psi_f = 0.285, .n_p = 2};
  EXPECT_GT(m.torque(-1, 2), m.torque(0, 2));
  EXPECT_LT(m.torque(1, 2), m.torque(0, 2));
}

}  // namespace
}  // namespace twinrate
