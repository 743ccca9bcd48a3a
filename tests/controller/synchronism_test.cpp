// When a loss of synchronism is called: by the time of the EMF residual beyond its limit.
#include "controller/synchronism.hpp"

#include <gtest/gtest.h>

#include "tests/support/drives.hpp"

namespace twinrate::synchronism_test {
namespace {

constexpr double kTs = 1e-4, kOmegaE = 400;

MachineParameters machine() {
  return {.R_s = 1.2, .L_d = 5e-4, .L_q = 5e-4, .psi_f = 0.007, .J = 1e-5, .n_p = 4};
}

// Low-pass of 5 kHz: the residual is there within a tick or two.
SynchronismParameters parameters() {
  return {.watch = true, .emf_limit = 0.6, .lowpass_Hz = 5000, .t_lost = 0.02, .t_find = 0.5};
}

// Ticks until a loss is called, at most `most`; the EMF is `share` of what the estimate expects.
int ticks_until_lost(Synchronism& synchronism, double share, int most) {
  for (int k = 1; k <= most; ++k)
    if (synchronism.lost({}, {0, 0}, {0, share * kOmegaE * 0.007}, kOmegaE)) return k;
  return most;
}

TEST(SynchronismTest, IsNotCalledLostWhereTheEmfIsWhereItIsExpected) {
  Synchronism synchronism(parameters(), machine(), kTs);
  EXPECT_EQ(ticks_until_lost(synchronism, 1, 20000), 20000);
  EXPECT_EQ(ticks_until_lost(synchronism, 0.5, 20000), 20000) << "within the limit";
}

TEST(SynchronismTest, BeforeTheEstimateHasAgreedTheLongerTimeCounts) {
  Synchronism synchronism(parameters(), machine(), kTs);
  EXPECT_NEAR(ticks_until_lost(synchronism, 0, 20000), 5000, 5);
}

TEST(SynchronismTest, OnceItHasAgreedTheShorterTimeCountsForGood) {
  Synchronism synchronism(parameters(), machine(), kTs);
  ticks_until_lost(synchronism, 1, 300);
  ticks_until_lost(synchronism, 0.5, 300);  // neither beyond the limit nor well within
  EXPECT_NEAR(ticks_until_lost(synchronism, 0, 20000), 200, 5);
  synchronism.reset();
  EXPECT_NEAR(ticks_until_lost(synchronism, 0, 20000), 5000, 5);
}

// Near standstill the EMF is compared with that of omega_e_min: noise of the voltage is no loss.
TEST(SynchronismTest, AtStandstillASmallVoltageIsNoLoss) {
  Synchronism synchronism(parameters(), machine(), kTs);
  const double emf = 0.3 * parameters().omega_e_min * 0.007;
  for (int k = 0; k < 20000; ++k) ASSERT_FALSE(synchronism.lost({}, {0, 0}, {0, emf}, 0)) << k;
}

TEST(SynchronismTest, TheTimeBeyondTheLimitCountsWithoutABreak) {
  Synchronism synchronism(parameters(), machine(), kTs);
  ticks_until_lost(synchronism, 1, 300);
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(ticks_until_lost(synchronism, 0, 150), 150) << i;  // 15 of 20 ms
    EXPECT_EQ(ticks_until_lost(synchronism, 1, 50), 50) << i;
  }
}

// The voltage of MEASUREMENT acted over the last interval: seen from its middle it is the EMF. Half
// a tick is 4.6 deg here.
TEST(SynchronismTest, TheControllerSeesTheVoltageInTheMiddleOfItsInterval) {
  for (const double shift : {0.0, 1.0}) {  // of half a tick
    Config config =
        test::load("dilys2021", {"controller.foc.synchronism.watch=true",
                                 "controller.foc.synchronism.emf_limit=0.1", "rates.f_s_Hz=5000",
                                 "controller.foc.synchronism.innovation_A=100", "start=flying"});
    const auto controller = make_controller(config);
    const double omega_e = 800, half = 0.5 * 2e-4 * omega_e;
    bool lost = false;
    for (std::int64_t k = 0; k < 5000 && !lost; ++k) {
      Measurement m{.k = k, .signals = kPhaseCurrents | kVoltage | kBusVoltage};
      m.v_dc = 24;
      Estimate e;
      e.theta_e = wrap_turn(omega_e * 2e-4 * static_cast<double>(k));
      e.omega_m = omega_e / 4;
      m.u_alphabeta = inverse_park({0, omega_e * 0.007}, e.theta_e - (1 - 2 * shift) * half);
      const Reference r{.k = k, .omega_m_ref = omega_e / 4};
      controller->step({m, e, r, nullptr});
      lost = controller->take_event().reason == Reason::kLostSynchronism;
    }
    EXPECT_EQ(lost, shift == 1.0) << shift;
  }
}

}  // namespace
}  // namespace twinrate::synchronism_test
