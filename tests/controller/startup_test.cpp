#include "controller/startup.hpp"

#include <gtest/gtest.h>

#include "tests/support/drives.hpp"

namespace twinrate {
namespace {

constexpr double kTs = 1e-3;

StartupParameters parameters() {
  return {.i_start = 1,
          .t_align = 0.05,
          .omega_e_handover = 100,
          .acceleration = 1000,
          .t_agree = 0.02,
          .t_give_up = 0.3};
}

// An estimate that rotates with the forced vector, with a lag of `lag`.
struct Follower {
  double lag = 0, speed_factor = 1;
  Estimate e;
  double omega_e_hat = 0;
  Startup::Drive step(Startup& startup, double direction = 1) {
    const Startup::Drive drive = startup.step(e, omega_e_hat, direction);
    omega_e_hat = speed_factor * drive.omega_e;
    // Angle of the vector at the next tick.
    e.theta_e = wrap_turn(drive.theta_e + drive.omega_e * kTs - lag);
    return drive;
  }
};

TEST(Startup, InactiveRunsFromTheFirstTick) {
  Startup startup(parameters(), false, kTs);
  const Startup::Drive drive = startup.step({}, 0, 1);
  EXPECT_EQ(drive.mode, Mode::kRun);
  EXPECT_FALSE(drive.handed_over);
}

TEST(Startup, AlignsAtNinetyThenAtZeroDegreesThenRampsAtItsAcceleration) {
  Startup startup(parameters(), true, kTs);
  Follower follower;
  for (int k = 0; k < 100; ++k) {
    const Startup::Drive drive = follower.step(startup);
    ASSERT_EQ(drive.mode, Mode::kAlign) << k;
    if (k != 49 && k != 50) {  // the tick of the change hangs on the rounding of the time
      EXPECT_NEAR(drive.theta_e, k < 50 ? kPi / 2 : 0, 1e-12) << k;
    }
    EXPECT_EQ(drive.omega_e, 0);
  }
  double omega_e = 0;
  int ramp = 0;
  for (int k = 0; k < 60; ++k) {
    const Startup::Drive drive = follower.step(startup);
    if (drive.mode == Mode::kIfRamp && drive.omega_e < 100 && drive.omega_e > 0) {
      EXPECT_NEAR(drive.omega_e - omega_e, 1000 * kTs, 1e-9);
      ++ramp;
    }
    omega_e = drive.omega_e;
  }
  EXPECT_GT(ramp, 50);
}

struct Outcome {
  Mode mode = Mode::kAlign;
  int handovers = 0;
  double t_s = 0;  // when the start-up ended
};

Outcome outcome_of(Follower follower, double direction = 1) {
  Startup startup(parameters(), true, kTs);
  Outcome outcome;
  for (int k = 0; k < 1000; ++k) {
    const Startup::Drive drive = follower.step(startup, direction);
    outcome.handovers += drive.handed_over;
    if (outcome.t_s == 0 && (drive.mode == Mode::kRun || drive.mode == Mode::kSafe))
      outcome.t_s = k * kTs;
    outcome.mode = drive.mode;
  }
  return outcome;
}

TEST(Startup, HandsOverOnceTheEstimateHasAgreedForItsTime) {
  const Outcome outcome = outcome_of({.lag = 0.3});
  EXPECT_EQ(outcome.mode, Mode::kRun);
  EXPECT_EQ(outcome.handovers, 1);
  EXPECT_NEAR(outcome.t_s, 0.1 + 0.1 + 0.02, 0.004);
}

// Fifteen ticks of agreement and one without, over and over: never twenty on end.
TEST(Startup, AnAgreementThatIsInterruptedBeginsAnew) {
  for (const int on_end : {15, 25}) {
    Startup startup(parameters(), true, kTs);
    Follower follower;
    Mode mode = Mode::kAlign;
    for (int k = 0; k < 1000; ++k) {
      follower.lag = k % (on_end + 1) == 0 ? kPi : 0;
      mode = follower.step(startup).mode;
    }
    EXPECT_EQ(mode, on_end < 20 ? Mode::kSafe : Mode::kRun) << on_end;
  }
}

TEST(Startup, RampsBackwardsToo) {
  EXPECT_EQ(outcome_of({.lag = 0.3}, -1).mode, Mode::kRun);
}

TEST(Startup, AcceptsOnlyAnAngleWithinSeventyFiveDegrees) {
  const double deg = kPi / 180;
  EXPECT_EQ(outcome_of({.lag = 73 * deg}).mode, Mode::kRun);
  EXPECT_EQ(outcome_of({.lag = -73 * deg}).mode, Mode::kRun);
  EXPECT_EQ(outcome_of({.lag = 77 * deg}).mode, Mode::kSafe);
  EXPECT_EQ(outcome_of({.lag = 180 * deg}).mode, Mode::kSafe);
}

TEST(Startup, AcceptsOnlyASpeedWithinThirtyPercent) {
  EXPECT_EQ(outcome_of({.speed_factor = 0.72}).mode, Mode::kRun);
  EXPECT_EQ(outcome_of({.speed_factor = 1.28}).mode, Mode::kRun);
  EXPECT_EQ(outcome_of({.speed_factor = 0.68}).mode, Mode::kSafe);
  EXPECT_EQ(outcome_of({.speed_factor = -1}).mode, Mode::kSafe);
}

TEST(Startup, GivesUpForGoodWhenItsTimeAtSpeedIsOver) {
  const Outcome outcome = outcome_of({.lag = kPi});
  EXPECT_EQ(outcome.mode, Mode::kSafe);
  EXPECT_EQ(outcome.handovers, 0);
  EXPECT_NEAR(outcome.t_s, 0.1 + 0.1 + 0.3, 0.004);
}

TEST(StartupEvents, SafeModeIsZeroVoltageAndOneEventWithItsReason) {
  // The estimate is constant; the command and the event show the safe mode.
  Config config = test::load("dilys2021", {"start=align_if"});
  const auto controller = make_controller(config);
  Measurement m;
  m.v_dc = 24;
  const Reference r{.omega_m_ref = 100};
  std::vector<Reason> reasons;
  Command c;
  for (m.k = 0; m.k < 10000; ++m.k) {
    c = controller->step({m, {}, r, nullptr});
    const ControllerEvent event = controller->take_event();
    if (event.reason == Reason::kNone) continue;
    reasons.push_back(event.reason);
    EXPECT_STRNE(event.text, "");
  }
  EXPECT_EQ(reasons, (std::vector<Reason>{Reason::kModeChange, Reason::kStartupGaveUp}));
  EXPECT_EQ(c.mode, Mode::kSafe);
  EXPECT_EQ(c.u_alphabeta_ref, Vec2(0, 0));
  EXPECT_EQ(controller->take_event().reason, Reason::kNone);
}

}  // namespace
}  // namespace twinrate
