// The lane engine against CVODE (plant), against the ordinary closed loop (figures), and on all
// instruction sets (equal bits).
#include "lanes/engine.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "tests/loop/closed_loop.hpp"

namespace twinrate::lanes {
namespace {

LaneSettings settings_of(const std::string& preset, const test::Overrides& overrides = {}) {
  Config config = test::load(preset, overrides);
  LaneSettings settings;
  EXPECT_EQ(lane_settings(config, settings), "");
  return settings;
}
Point point_of_preset(const test::Overrides& overrides = {}) {
  Config config = test::load("dilys2021", overrides);
  return point_of(config.drive());
}

// Speeds, ratios, loads and starts of a sweep, lost ones among them.
std::vector<Point> mixed_points(Policy policy) {
  std::vector<Point> points;
  for (double omega_e : {150.0, 400.0, 900.0})
    for (int n : {1, 4, 12, 13, 30}) {
      Point p = point_of_preset();
      p.omega_e_ref_rad_s = omega_e;
      p.n = n;
      p.policy = policy;
      p.seed = static_cast<std::uint64_t>(n) + 3;
      p.flying = n == 4;
      p.full_until_s = n == 30 ? 0.3 : 0;
      p.T_load_Nm = n == 12 ? 0.02 : 0;
      p.duration_s = 0.6 + 0.01 * n;
      p.settle_s = 0.3;
      points.push_back(p);
    }
  return points;
}

std::vector<PointResult> results_of(const LaneSettings& settings, const std::vector<Point>& points,
                                    Isa isa, int threads = 1) {
  std::vector<PointResult> results(points.size());
  run_points(settings, points, results, threads, isa);
  return results;
}

void expect_same_bits(const PointResult& a, const PointResult& b) {
  EXPECT_EQ(a.locked, b.locked);
  EXPECT_EQ(a.angle_error_rms_rad, b.angle_error_rms_rad);
  EXPECT_EQ(a.angle_error_max_rad, b.angle_error_max_rad);
  EXPECT_EQ(a.lost_at_s, b.lost_at_s);
}

constexpr Policy kPolicies[] = {Policy::kPaper, Policy::kImmediate, Policy::kExtrapolate,
                                Policy::kRotate, Policy::kRotorFrame};

TEST(LaneEngine, EveryInstructionSetGivesTheScalarBits) {
  for (const char* prediction : {"euler", "rk4"}) {
    const LaneSettings settings =
        settings_of("dilys2021", {fmt::format("estimator.prediction={}", prediction)});
    for (Policy policy : kPolicies) {
      const auto points = mixed_points(policy);
      const auto scalar = results_of(settings, points, Isa::kScalar);
      EXPECT_TRUE(std::any_of(scalar.begin(), scalar.end(), [](auto& r) { return r.locked; }));
      for (Isa isa : {Isa::kPortable, Isa::kAvx2, Isa::kAvx512}) {
        if (!available(isa)) continue;
        SCOPED_TRACE(kIsaNames[static_cast<int>(isa)]);
        const auto lanes = results_of(settings, points, isa);
        for (std::size_t i = 0; i < points.size(); ++i) expect_same_bits(lanes[i], scalar[i]);
      }
    }
  }
}

TEST(LaneEngine, APointDependsNeitherOnItsNeighboursNorOnThreads) {
  const LaneSettings settings = settings_of("dilys2021");
  auto points = mixed_points(Policy::kPaper);
  const auto forwards = results_of(settings, points, widest(), 2);
  std::reverse(points.begin(), points.end());
  auto backwards = results_of(settings, points, widest(), 1);
  std::reverse(backwards.begin(), backwards.end());
  for (std::size_t i = 0; i < points.size(); ++i) expect_same_bits(forwards[i], backwards[i]);
}

TEST(LaneEngine, TheFiguresAreThoseOfTheClosedLoop) {
  // Not bit for bit: a sample can differ by one count of the ADC.
  for (const char* prediction : {"euler", "rk4"})
    for (const char* policy : {"paper", "immediate"})
      for (int n : {1, 5, 11, 14}) {
        const test::Overrides overrides{fmt::format("estimator.prediction={}", prediction),
                                        fmt::format("gain.policy={}", policy),
                                        fmt::format("rates.n={}", n),
                                        "load.T_load_Nm=0.03",
                                        "run.duration_s=1.2",
                                        "run.settle_s=0.6"};
        SCOPED_TRACE(fmt::format("{} {} n = {}", prediction, policy, n));
        const test::Figures loop = test::run("dilys2021", overrides);
        const auto lane = results_of(settings_of("dilys2021", overrides),
                                     {point_of_preset(overrides)}, Isa::kScalar)[0];
        EXPECT_EQ(lane.locked, loop.locked);
        if (!loop.locked) continue;
        EXPECT_NEAR(lane.angle_error_rms_rad, loop.angle_error_rms, 0.02 * loop.angle_error_rms);
        EXPECT_NEAR(lane.angle_error_max_rad, loop.angle_error_max, 0.15 * loop.angle_error_max);
      }
}

TEST(LaneEngine, WithoutNoiseAndAdcItIsTheClosedLoopToRounding) {
  for (int n : {1, 7}) {
    const test::Overrides overrides{"sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0",
                                    "run.duration_s=0.8", "run.settle_s=0.3",
                                    fmt::format("rates.n={}", n)};
    const test::Figures loop = test::run("dilys2021", overrides);
    const auto lane = results_of(settings_of("dilys2021", overrides), {point_of_preset(overrides)},
                                 Isa::kScalar)[0];
    // The difference is the plant's 3e-8 A an interval.
    EXPECT_NEAR(lane.angle_error_rms_rad, loop.angle_error_rms, 1e-7);
    EXPECT_NEAR(lane.angle_error_max_rad, loop.angle_error_max, 1e-6);
  }
}

// A gain is used for 7 ticks, so the angle of its linearisation shows in the error.
TEST(LaneEngine, WithoutNoiseEachGainPolicyIsThatOfTheClosedLoop) {
  for (const char* policy : {"immediate", "extrapolate", "rotate", "rotor_frame"}) {
    SCOPED_TRACE(policy);
    const test::Overrides overrides{
        "sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0", "run.duration_s=0.5",
        "run.settle_s=0.1",        "rates.n=7",         fmt::format("gain.policy={}", policy)};
    const test::Figures loop = test::run("dilys2021", overrides);
    const auto lane = results_of(settings_of("dilys2021", overrides), {point_of_preset(overrides)},
                                 Isa::kScalar)[0];
    EXPECT_TRUE(loop.locked && lane.locked);
    EXPECT_NEAR(lane.angle_error_rms_rad, loop.angle_error_rms, 1e-7);
    EXPECT_NEAR(lane.angle_error_max_rad, loop.angle_error_max, 1e-6);
  }
}

// A step of the reference at 1 A: the current limit holds for 30 ms. A speed loop that winds up
// overshoots, and the bias of the Euler prediction follows the speed.
TEST(LaneEngine, AtTheCurrentLimitTheSpeedLoopIsThatOfTheClosedLoop) {
  const test::Overrides overrides{
      "sensors.i_noise_rms_A=0", "sensors.i_lsb_A=0", "run.duration_s=0.3",
      "run.settle_s=0.02",       "rates.n=1",         "reference.slew_rad_s2=0",
      "controller.foc.i_max_A=1"};
  const test::Figures loop = test::run("dilys2021", overrides);
  const auto lane = results_of(settings_of("dilys2021", overrides), {point_of_preset(overrides)},
                               Isa::kScalar)[0];
  EXPECT_TRUE(loop.locked && lane.locked);
  EXPECT_NEAR(lane.angle_error_rms_rad, loop.angle_error_rms, 1e-6);
  EXPECT_NEAR(lane.angle_error_max_rad, loop.angle_error_max, 1e-5);
}

// Friction that takes the torque of 3 A, 0.126 Nm, at 50 rad/s: half the reference, though the
// filter follows. A speed that is not held is no loss of synchronism.
TEST(LaneEngine, ADriveAtHalfItsSpeedIsLockedAsLongAsTheFilterFollows) {
  const test::Overrides overrides{"machine.B_Nms=2.52e-3", "run.duration_s=1", "run.settle_s=0.5"};
  const auto lane = results_of(settings_of("dilys2021", overrides), {point_of_preset(overrides)},
                               Isa::kScalar)[0];
  EXPECT_TRUE(lane.locked);
  EXPECT_EQ(lane.lost_at_s, -1);
  EXPECT_LT(lane.angle_error_max_rad, 0.5);
}

// The largest difference of an interval's currents to CVODE's, along a start to this speed.
double worst_interval_A(const test::Overrides& overrides) {
  const LaneSettings settings = settings_of("dilys2021", overrides);
  Config config = test::load("dilys2021", overrides);
  const DriveConfig drive = config.drive();
  const DriveModel model(drive.machine, {}, drive.inverter.v_dc, Saliency::kRotor);
  const auto cvode = make_integrator(Engine::kCvode, model, 1);
  const double n_p = drive.machine.n_p;
  test::ClosedLoop loop(std::move(config));
  double worst_A = 0;
  for (int k = 0; k < 2500; ++k) {
    loop.tick();
    const Truth& t = loop.truth();
    const double theta_e = twinrate::wrap_turn(n_p * t.theta_m);  // CVODE's tolerance is relative
    const Vec2 i = inverse_park(t.i_dq, theta_e), u = loop.command().u_alphabeta_ref;
    const PlantState x = cvode->advance({t.i_dq[0], t.i_dq[1], t.omega_m, theta_e / n_p},
                                        {.u_alphabeta = u, .T_load = 0.02}, drive.T_s());
    const PlantSample lane =
        advance_plant(settings, {i[0], i[1], n_p * t.omega_m, theta_e}, u[0], u[1], 0.02);
    const Vec2 expected = inverse_park(x.head<2>(), n_p * x[3]);
    worst_A = std::max(worst_A, (Vec2(lane.i_alpha, lane.i_beta) - expected).norm());
    EXPECT_NEAR(twinrate::wrap_pi(lane.theta_e - n_p * x[3]), 0, 2e-7);
    EXPECT_NEAR(lane.omega_e, n_p * x[2], 5e-4);
  }
  return worst_A;
}

TEST(LaneEngine, ThePlantIsWithinTenMicroampereOfCvodeAnInterval) {
  const double at_400 = worst_interval_A({});
  EXPECT_LT(at_400, 1e-7);
  EXPECT_GT(at_400, 1e-9);
  EXPECT_LT(worst_interval_A({"reference.omega_e_rad_s=1570", "rates.n=1"}), 3e-6);
  EXPECT_LT(worst_interval_A({"rates.f_s_Hz=1500", "rates.n=1"}), 2e-6);  // several steps
}

TEST(LaneEngine, LosesSynchronismAtThirteenAndKeepsItAtTwelve) {
  const LaneSettings settings = settings_of("dilys2021");
  std::vector<Point> points;
  for (int n : {12, 13})
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      Point p = point_of_preset();
      p.n = n;
      p.seed = seed;
      points.push_back(p);
    }
  const auto results = results_of(settings, points, widest());
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(results[i].locked, points[i].n == 12) << points[i].seed;
    EXPECT_EQ(results[i].lost_at_s < 0, results[i].locked);
  }
}

TEST(LaneEngine, NamesWhatItDoesNotCover) {
  const auto why = [](const test::Overrides& overrides) {
    Config config = test::load("dilys2021", overrides);
    LaneSettings settings;
    return lane_settings(config, settings);
  };
  EXPECT_EQ(why({}), "");
  EXPECT_NE(why({"machine.L_q_H=0.6e-3"}), "");
  EXPECT_NE(why({"start=align_if"}), "");
  EXPECT_NE(why({"estimator.prediction=exact"}), "");
  EXPECT_NE(why({"controller.angle_source=truth"}), "");
  EXPECT_NE(why({"reference.omega_e_rad_s=[[0, 100], [1, 200]]"}), "");
}

TEST(LaneEngine, StopsWhenTold) {
  const LaneSettings settings = settings_of("dilys2021");
  const auto points = mixed_points(Policy::kPaper);
  std::vector<PointResult> results(points.size());
  const std::atomic<bool> stop = true;
  std::atomic<std::size_t> done = 0;
  run_points(settings, points, results, 1, widest(), &stop, &done);
  EXPECT_EQ(done, 0u);
  run_points(settings, points, results, 2, widest(), nullptr, &done);
  EXPECT_EQ(done, points.size());
}

}  // namespace
}  // namespace twinrate::lanes
