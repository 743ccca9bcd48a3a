// The watch over the synchronism in the closed loop, for both controllers: it names a stall in time,
// calls no load step a loss, and stops the rotor where the drive file says so.
#include <gtest/gtest.h>

#include "loop/closed_loop.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::watched_test {
namespace {

struct Seen {
  std::int64_t lost_k = -1, beyond_90_k = -1;
  int reported = 0;
  double omega_m_end = 0;
  bool ramped = false;  // a forced vector after the loss
  Mode mode_end = Mode::kRun;
};

Seen run(const std::string& drive, const std::string& kind, double duration_s,
         test::Overrides overrides) {
  const std::string table = "controller." + kind + ".synchronism.";
  overrides.insert(overrides.end(), {"controller.kind=" + kind, table + "watch=true",
                                     "load.slew_Nm_s=0", "machine.i_trip_A=30"});
  Config config = test::load(drive, overrides);
  ClosedLoop loop(config);
  Seen seen;
  while (static_cast<double>(loop.k()) * config.drive().T_s() < duration_s) {
    const TickRecord& tick = loop.step();
    const double error =
        wrap_pi(tick.estimate.theta_e - config.drive().machine.n_p * tick.truth.theta_m);
    if (seen.beyond_90_k < 0 && std::abs(error) > kPi / 2) seen.beyond_90_k = tick.command.k;
    seen.ramped = seen.ramped || (seen.reported > 0 && tick.command.mode == Mode::kIfRamp);
    seen.omega_m_end = tick.truth.omega_m;
    seen.mode_end = tick.command.mode;
    if (tick.event.reason != Reason::kLostSynchronism) continue;
    ++seen.reported;
    seen.lost_k = tick.command.k;
  }
  return seen;
}

class Watched : public testing::TestWithParam<const char*> {};

// Three times the rated torque from tick 5000 on.
const char* const kStall = "load.T_load_Nm=[[0, 0], [1, 0.2], [1.05, 0]]";

TEST_P(Watched, AStallIsNamedOnceWithinTwentyMilliseconds) {
  const Seen seen = run("dilys2021", GetParam(), 1.3, {kStall});
  EXPECT_EQ(seen.reported, 1);
  EXPECT_GT(seen.lost_k, 5000);
  EXPECT_LE(seen.lost_k, (seen.beyond_90_k < 0 ? 5000 : seen.beyond_90_k) + 100);
  EXPECT_EQ(seen.mode_end, Mode::kSafe);
  EXPECT_FALSE(seen.ramped);
}

// The speed dips by half, and the innovations pass nis_limit for 15 ms.
TEST_P(Watched, AStepOfHalfTheRatedLoadIsNoLoss) {
  const Seen seen =
      run("dilys2021", GetParam(), 1.6, {"load.T_load_Nm=[[0, 0], [1, 0.03], [1.3, 0]]"});
  EXPECT_EQ(seen.reported, 0);
  EXPECT_EQ(seen.beyond_90_k, -1);
}

TEST_P(Watched, AControlledStopBringsTheRotorToRestBeforeItIsOff) {
  const std::string table = std::string("controller.") + GetParam();
  const Seen seen =
      run("dilys2021", GetParam(), 2.0, {kStall, table + ".synchronism.reaction=stop"});
  EXPECT_EQ(seen.reported, 1);
  EXPECT_TRUE(seen.ramped);
  EXPECT_EQ(seen.mode_end, Mode::kSafe);
  EXPECT_NEAR(seen.omega_m_end, 0, 1);
}

INSTANTIATE_TEST_SUITE_P(Controllers, Watched, testing::Values("foc", "lqr"),
                         [](const auto& kind) { return std::string(kind.param); });

// As a request of `twinrate set compensation=..` changes it.
TEST_P(Watched, FollowsAnotherCompensationAsTheControllerAloneDoes) {
  const std::string kind = GetParam();
  Config config = test::load("niewiara2020", {"estimator.kind=ekf_joint", "controller.kind=" + kind,
                                              "controller.compensation=off",
                                              "controller." + kind + ".synchronism.watch=true"});
  const auto controller = make_controller(config);
  Measurement m{.k = 0, .signals = kPhaseCurrents | kVoltage, .v_dc = 235.4};
  Estimate e;
  e.T_load = 2;
  const auto step = [&] {
    controller->step({m, e, Reference{}});
    ++m.k, m.t_ns += 100000;
    return controller->take_event().reason;
  };
  EXPECT_EQ(step(), Reason::kNone);
  controller->follow_compensation(Profile(static_cast<double>(Compensation::kLoad)));
  EXPECT_EQ(step(), Reason::kModeChange);
}

// A load step that stalls this servo for a moment: its angle is the encoder's.
TEST(WatchedSensor, AnAngleOfASensorIsNotLost) {
  const Seen seen = run("baldor_ecs101", "foc", 1.4,
                        {"load.T_load_Nm=[[0, 0], [1, 14.85], [1.3, 0]]",
                         "controller.angle_source=estimate", "machine.i_trip_A=1000"});
  EXPECT_EQ(seen.reported, 0);
}

}  // namespace
}  // namespace twinrate::watched_test
