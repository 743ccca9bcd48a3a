// One point of a sweep: its keys, both engines, and the filter alone on a recorded drive.
#include <gtest/gtest.h>

#include <cmath>

#include "lanes/engine.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "tests/sweep/small_plan.hpp"

namespace twinrate::sweep {
namespace {

// A recorded start from standstill to 64 Hz with a gain every tick.
RunLog recorded_start(double f_e_Hz) {
  const Plan plan{.drive = "dilys2021", .policies = {"paper"}};
  const DriveConfig base = load_drive(plan.drive).drive();
  Config config = load_drive(plan.drive, point_overrides(plan, base, {"paper", f_e_Hz, 1}, 1));
  RunLog log;
  log.path = "simulated";
  log.config_toml = config.resolved();
  ClosedLoop loop(config);
  while (loop.k() < config.drive().steps()) {
    const TickRecord& tick = loop.step();
    log.measurement.push_back(tick.measurement);
    log.truth.push_back(tick.truth);
    log.estimate.push_back(tick.estimate);
  }
  return log;
}

// The last n before the first loss.
template <class Run>
int limit_of(Run run) {
  for (int n = 1; n < 40; ++n)
    if (!run(n).locked) return n - 1;
  return 40;
}

// The filter alone on recorded samples, without feedback through the controller.
TEST(RecordedDrive, TheFilterAloneHasTheLimitOfTheClosedLoopWithinOneStep) {
  const double f_e_Hz = 64;
  const RunLog log = recorded_start(f_e_Hz);
  const Search search{"paper", f_e_Hz, 1};
  const Plan plan{.drive = "dilys2021", .policies = {"paper"}};
  const int alone = limit_of([&](int n) { return run_on_log(log, plan, search, n); });
  const DriveConfig base = load_drive(plan.drive).drive();
  const int closed = limit_of([&](int n) { return in_lanes(plan, base, search, n); });
  EXPECT_NEAR(alone, closed, 1);
  EXPECT_NEAR(closed, 12, 1);
  // Another policy has another limit: the requested policy is used.
  EXPECT_TRUE(run_on_log(log, plan, {"rotate", f_e_Hz, 1}, closed + 3).locked);
  // So is the filter of the drive file that is given, not that of the recording.
  Plan joint = plan;
  joint.overrides = {"estimator.kind=dq_ekf"};
  EXPECT_TRUE(run_on_log(log, joint, search, closed + 3).locked);
  RunLog bare = log;
  bare.config_toml.clear();
  EXPECT_EQ(run_on_log(bare, joint, search, 3).n, 3);
}

// A drive of align_if turns only after its start. Without the time of the start its window would end
// before the hand-over, and every gain would be a loss.
TEST(Speeds, TheWindowBeginsAfterTheStart) {
  Plan plan{.drive = "siemens_1ft7044", .speeds_Hz = {60}, .policies = {"paper"}, .seeds = 1};
  Config config = load_drive(plan.drive);
  const DriveConfig& base = config.drive();
  EXPECT_THROW(expect_speeds_reached(plan, base), BadInput);
  const PointTimes before = point_times(plan, base, 60, 1);
  plan.start_takes_s = start_takes_s(config);
  EXPECT_GT(plan.start_takes_s, 0.1);
  EXPECT_NEAR(point_times(plan, base, 60, 1).settle_s, before.settle_s + plan.start_takes_s, 1e-12);
  EXPECT_NO_THROW(expect_speeds_reached(plan, base));
  Config aligned = load_drive("dilys2021");
  EXPECT_EQ(start_takes_s(aligned), 0);
}

// At 24 V the EMF of 400 Hz is beyond the voltage, and J = 1e-2 kgm2 does not follow the ramp.
TEST(Speeds, ASpeedThatTheDriveDoesNotReachIsRefused) {
  Plan plan = small_plan();
  plan.speeds_Hz = {64};
  EXPECT_NO_THROW(expect_speeds_reached(plan, load_drive(plan.drive).drive()));
  plan.speeds_Hz = {64, 400};
  EXPECT_THROW(expect_speeds_reached(plan, load_drive(plan.drive).drive()), BadInput);
  plan.speeds_Hz = {64};
  plan.overrides = {"machine.J_kgm2=1e-2"};
  EXPECT_THROW(expect_speeds_reached(plan, load_drive(plan.drive, plan.overrides).drive()),
               BadInput);
}

// At 30 Hz the start decides the limit, and the recording has a start on a good angle. Switched at
// speed, both are equal.
TEST(RecordedDrive, SwitchedAtSpeedTheLimitIsTheClosedLoopsAtThirtyHertzToo) {
  const double f_e_Hz = 30;
  const RunLog log = recorded_start(f_e_Hz);
  const Search search{"paper", f_e_Hz, 1};
  const Plan plan{.drive = "dilys2021", .policies = {"paper"}, .start = "switched"};
  const DriveConfig base = load_drive(plan.drive).drive();
  const int alone = limit_of([&](int n) { return run_on_log(log, plan, search, n); });
  const int closed = limit_of([&](int n) { return in_lanes(plan, base, search, n); });
  EXPECT_NEAR(alone, closed, 1);
  EXPECT_NEAR(closed, 25, 2);
}

// By hand: the recording is judged from 0.5118 s on. 0.3 s before are 1058 whole ticks of 0.2 ms, and
// 1053 = 117 9 is the last snapshot until then.
TEST(RecordedDrive, TheSwitchIsHalfATickBeforeASnapshotThreeTenthsBeforeTheWindow) {
  const double f_e_Hz = 30;
  const RunLog log = recorded_start(f_e_Hz);
  const Search search{"paper", f_e_Hz, 1};
  Plan plan{.drive = "dilys2021", .policies = {"paper"}, .start = "switched"};
  const Point switched = run_on_log(log, plan, search, 9);
  plan.start = "ramp";
  const auto from = [&](double n_from_s) {
    plan.overrides = {"rates.n_from_s=" + std::to_string(n_from_s)};
    return run_on_log(log, plan, search, 9).angle_error_rms;
  };
  EXPECT_EQ(switched.angle_error_rms, from(1052.5 * 2e-4));
  EXPECT_NE(switched.angle_error_rms, from(1061.5 * 2e-4));
}

DriveConfig point_of(const Plan& plan, const Search& search, int n) {
  return load_drive(plan.drive, point_overrides(plan, load_drive(plan.drive).drive(), search, n))
      .drive();
}

// By hand: a ramp to 2 pi 64 rad/s at 16000 rad/s^2 takes 25.1 ms.
TEST(PointOfASweep, IsJudgedOnceTheSpeedHasStoodForHalfASecond) {
  Plan plan = small_plan();
  const double ramp_s = kTwoPi * 64 / 16000;
  const DriveConfig drive = point_of(plan, {"rotate", 64, 3}, 7);
  EXPECT_NEAR(drive.run.settle_s, ramp_s + 0.5, 1e-9);
  EXPECT_NEAR(drive.run.duration_s, ramp_s + 1.5, 1e-9);
  EXPECT_EQ(drive.run.seed, 3);
  EXPECT_EQ(drive.rates.n, 7);
  EXPECT_EQ(drive.gain.policy, GainPolicy::kRotate);
  EXPECT_NEAR(drive.reference_at(0).omega_m_ref * drive.machine.n_p, kTwoPi * 64, 1e-9);
  // Five turns of 2 Hz; three gains of 0.5 s.
  EXPECT_NEAR(point_of(plan, {"paper", 2, 1}, 7).run.duration_s, kTwoPi * 2 / 16000 + 0.5 + 2.5,
              1e-9);
  EXPECT_NEAR(point_of(plan, {"paper", 64, 1}, 2500).run.duration_s, ramp_s + 0.5 + 1.5, 1e-9);
}

TEST(PointOfASweep, HasTheLoadAskedForAndHalfASecondMoreForIt) {
  Plan plan = small_plan();
  const DriveConfig idle = point_of(plan, {"paper", 64, 1}, 5);
  plan.load_pu = 0.4;
  const DriveConfig drive = point_of(plan, {"paper", 64, 1}, 5);
  ASSERT_GT(drive.machine.T_rated, 0);
  EXPECT_NEAR(drive.load.T_load_Nm.at(1), 0.4 * drive.machine.T_rated, 1e-12);
  EXPECT_NEAR(drive.run.settle_s - idle.run.settle_s, 0.5, 1e-9);
}

TEST(PointOfASweep, ALoadOfZeroRemovesThatOfTheDriveFile) {
  Plan plan = small_plan();
  plan.overrides.push_back("load.T_load_Nm=[[0, 0], [0.6, 0.03]]");
  EXPECT_EQ(point_of(plan, {"paper", 64, 1}, 5).load.T_load_Nm.at(1), 0.03);
  plan.load_pu = 0;
  EXPECT_EQ(point_of(plan, {"paper", 64, 1}, 5).load.T_load_Nm.at(1), 0);
}

// n = 1 up to the first whole gain behind 0.2 s: ticks of 0.2 ms, 1000 of them and 1001 = 7 143.
TEST(PointOfASweep, SwitchedAtSpeedIsJudgedThreeTenthsBehindTheSwitch) {
  Plan plan = small_plan();
  plan.start = "switched";
  const DriveConfig drive = point_of(plan, {"paper", 64, 1}, 7);
  EXPECT_EQ(drive.start, Start::kFlying);
  EXPECT_EQ(drive.background_rate().from, 1001);
  EXPECT_NEAR(drive.run.settle_s, 1001 * 2e-4 + 0.3, 1e-9);
}

// The two engines are one drive: the same point gives the same figures, to a count of the ADC.
TEST(PointOfASweep, HasTheSameFiguresInBothEngines) {
  Plan plan = small_plan();
  plan.load_pu = 0.4;
  const DriveConfig base = load_drive(plan.drive).drive();
  const Search search{"extrapolate", 64, 1};
  const Point reference = run_in_process(plan, base, search, 8);
  const Point lane = in_lanes(plan, base, search, 8);
  ASSERT_TRUE(reference.locked && lane.locked);
  EXPECT_NEAR(lane.angle_error_rms, reference.angle_error_rms, 0.03 * reference.angle_error_rms);
  EXPECT_NEAR(lane.angle_error_max, reference.angle_error_max, 0.2 * reference.angle_error_max);
  EXPECT_GT(lane.angle_error_max, 1.2 * lane.angle_error_rms);
}

TEST(PointOfASweep, HasTheSameBitsBesideOtherSeedsAndRatios) {
  for (const char* start : {"ramp", "switched"}) {
    Plan plan = small_plan();
    plan.start = start;
    const DriveConfig base = load_drive(plan.drive).drive();
    std::vector<Task> tasks;
    for (int seed : {1, 2, 3})
      for (int n : {3, 12}) tasks.push_back({{"paper", 100, seed}, n});
    const LaneDrive shared = lane_drive(plan, base, tasks.front().search).value();
    const std::vector<Point> together = run_in_lanes(plan, shared, tasks, 2);
    ASSERT_EQ(together.size(), tasks.size());
    for (std::size_t i = 0; i < tasks.size(); ++i) {
      // As the drive file with all keys of the point has it.
      const DriveConfig drive = point_of(plan, tasks[i].search, tasks[i].n);
      lanes::PointResult alone;
      const lanes::Point asked = lanes::point_of(drive);
      lanes::run_points(shared.settings, {&asked, 1}, {&alone, 1}, 1);
      EXPECT_EQ(together[i].search.seed, tasks[i].search.seed);
      EXPECT_EQ(together[i].locked, alone.locked) << start << " " << i;
      EXPECT_EQ(together[i].angle_error_rms, alone.angle_error_rms_rad) << start << " " << i;
      EXPECT_EQ(together[i].angle_error_max, alone.angle_error_max_rad) << start << " " << i;
    }
  }
}

}  // namespace
}  // namespace twinrate::sweep
