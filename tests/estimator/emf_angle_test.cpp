#include "estimator/emf_angle.hpp"

#include <gtest/gtest.h>

namespace twinrate::emf_angle_test {
namespace {

constexpr double kTs = 1e-4, kPsi = 0.285;

// The EMF of a rotor at omega_e, tick by tick.
struct Rotor {
  double theta_e = 0, omega_e = 0;
  EmfAngle s;
  void tick(const EmfAngleParameters& p) {
    theta_e += omega_e * kTs;
    s = emf_angle_step(s, p, inverse_park({0, omega_e * kPsi}, theta_e), kPsi, kTs);
  }
};

TEST(EmfAngle, FollowsARotorThatTurnsEitherWayWithBothSpeeds) {
  for (SpeedFrom speed_from : {SpeedFrom::kEmf, SpeedFrom::kAngleRate}) {
    for (double omega_e : {400.0, -400.0}) {
      EmfAngleParameters p;
      p.speed_from = speed_from;
      Rotor rotor{.theta_e = 1, .omega_e = omega_e, .s = emf_angle_at(1, omega_e)};
      for (int k = 0; k < 1000; ++k) {
        rotor.tick(p);
        ASSERT_NEAR(wrap_pi(rotor.s.theta_now(kTs) - rotor.theta_e), 0, 1e-9) << k;
        ASSERT_NEAR(rotor.s.omega_f, omega_e, 1e-6);
      }
    }
  }
}

TEST(EmfAngle, WithThePiOfEquation30TheAngleOfABackwardRotorIsTheRotorsNotTheEmfs) {
  EmfAngleParameters p;
  Rotor rotor{.theta_e = 2, .omega_e = -300, .s = emf_angle_at(0, 0)};  // wrong initial state
  for (int k = 0; k < 2000; ++k) rotor.tick(p);
  EXPECT_NEAR(wrap_pi(rotor.s.theta_now(kTs) - rotor.theta_e), 0, 1e-6);
  EXPECT_NEAR(std::abs(wrap_pi(rotor.s.theta_emf - rotor.s.theta_e)), kPi, 1e-6);
}

TEST(EmfAngle, ExtrapolatesBetweenItsIntervals) {
  EmfAngleParameters p;
  Rotor rotor{.theta_e = 0, .omega_e = 400, .s = emf_angle_at(0, 400)};
  for (int k = 1; k < 40; ++k) {
    rotor.tick(p);
    EXPECT_EQ(rotor.s.ticks, k % 5);
    EXPECT_NEAR(rotor.s.theta_now(kTs), 0.04 * k, 1e-9);
  }
}

TEST(EmfAngle, LimitsItsChangeToTwiceWhatTheSpeedExplains) {
  EmfAngleParameters p;
  p.divider = 1;
  p.lowpass_Hz = 0.1;  // the filtered speed is nearly constant
  p.limit_floor = 0;
  EmfAngle s = emf_angle_at(0, 200);
  // A rotor seen 1 rad away: 2 * 200 rad/s * 100 us is allowed.
  s = emf_angle_step(s, p, inverse_park({0, 200 * kPsi}, 1.0), kPsi, kTs);
  EXPECT_NEAR(s.theta_e, 2 * 200 * kTs, 1e-6);
  p.limit = false;
  s = emf_angle_step(s, p, inverse_park({0, 200 * kPsi}, 1.5), kPsi, kTs);
  EXPECT_NEAR(s.theta_e, 1.5, 1e-12);
}

TEST(EmfAngle, FreezesAtStandstillWithoutAFloorAsPrintedAndMovesWithOne) {
  for (double floor : {0.0, 0.01}) {
    EmfAngleParameters p;
    p.limit_floor = floor;
    p.lowpass_Hz = 0.1;
    EmfAngle s = emf_angle_at(0, 0);
    for (int k = 0; k < 50; ++k) s = emf_angle_step(s, p, inverse_park({0, 1e-9}, 0.5), kPsi, kTs);
    EXPECT_NEAR(s.theta_e, floor > 0 ? 0.1 : 0, 1e-6);  // ten intervals
  }
}

TEST(EmfAngle, TheLowPassIsTheBilinearFirstOrderOne) {
  EmfAngleParameters p;
  p.lowpass_Hz = 50;
  Rotor rotor{.theta_e = 0, .omega_e = 300, .s = emf_angle_at(0, 0)};
  const int ticks = 5 * 20;  // 10 ms
  for (int k = 0; k < ticks; ++k) rotor.tick(p);
  const double aT = kTwoPi * 50 * 5 * kTs, pole = (2 - aT) / (2 + aT);
  // Twenty intervals of a step, of which the first sees half of it.
  EXPECT_NEAR(rotor.s.omega_f, 300 * (1 - std::pow(pole, 19) * (1 - aT / (2 + aT))), 1e-6);
}

}  // namespace
}  // namespace twinrate::emf_angle_test
