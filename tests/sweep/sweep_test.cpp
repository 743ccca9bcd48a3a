// The parts of a sweep: searches, files, shards, and predictions of f_bmin.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "estimator/make_filter.hpp"
#include "lanes/engine.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "loop/stale_gain.hpp"
#include "sweep/cost.hpp"
#include "sweep/merge.hpp"
#include "sweep/run.hpp"
#include "sweep/store.hpp"
#include "tests/sweep/small_plan.hpp"

namespace twinrate::sweep {
namespace {

namespace fs = std::filesystem;

class SweepTest : public ::testing::Test {
 public:
  SweepTest()
      : directory_(fs::temp_directory_path() / ("twinrate-sweep-" + std::to_string(getpid()))) {
    fs::remove_all(directory_);
    fs::create_directories(directory_);
  }
  ~SweepTest() override { fs::remove_all(directory_); }
  std::string path(const std::string& name) const { return (directory_ / name).string(); }
  static std::string text(const std::string& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  void run(Plan plan, const std::string& name, int shard = 0, int shards = 1) const {
    plan.shard = shard;
    plan.shards = shards;
    ResultDirectory directory(path(name), ResultKind::kSweep, false, true);
    run_searches(plan, load_drive(plan.drive, plan.overrides), directory,
                 {.resume = true, .json = true});
  }

 private:
  fs::path directory_;
};

// A drive that keeps synchronism for every n below `first_lost`.
std::vector<int> tried(int first_lost, int n_max) {
  const Search search{"paper", 50, 1};
  std::vector<Point> points;
  std::vector<int> order;
  while (true) {
    const auto n = next_to_try(of_search(points, search), search, n_max);
    if (!n) return order;
    order.push_back(*n);
    points.push_back({.search = search, .f_s_Hz = 5000, .n = *n, .locked = *n < first_lost});
  }
}

TEST(Search, RisesByOneAndStopsAtTheFirstLoss) {
  EXPECT_EQ(tried(4, 100), (std::vector<int>{1, 2, 3, 4}));
  EXPECT_EQ(tried(1, 100), (std::vector<int>{1}));
  EXPECT_EQ(tried(100, 3), (std::vector<int>{1, 2, 3}));
}

TEST(Search, TriesEveryRatioBelowALoss) {
  for (int first_lost : {65, 70, 71, 99, 200, 483}) {
    const std::vector<int> order = tried(first_lost, 5000);
    for (int n : {first_lost - 1, first_lost})
      EXPECT_EQ(std::count(order.begin(), order.end(), n), 1) << n;
    EXPECT_LT(order.size(), 64u + 60u);
  }
}

TEST(Shards, TakeEverySearchOnce) {
  Plan plan = small_plan();
  set_shard(plan, "2/5");
  EXPECT_EQ(plan.shard, 2);
  EXPECT_EQ(plan.shards, 5);
  for (const char* bad : {"5/5", "-1/5", "1", "1/0", "a/b", "1/2x", ""})
    EXPECT_THROW(set_shard(plan, bad), BadInput) << bad;
}

TEST(Shards, AreTheRanksOfALauncher) {
  Plan plan;
  setenv("PMI_RANK", "3", 1);
  setenv("PMI_SIZE", "4", 1);
  EXPECT_TRUE(set_shard_from_launcher(plan));
  unsetenv("PMI_RANK");
  unsetenv("PMI_SIZE");
  EXPECT_EQ(plan.shard, 3);
  EXPECT_EQ(plan.shards, 4);
  Plan alone;
  EXPECT_FALSE(set_shard_from_launcher(alone));
}

TEST_F(SweepTest, TwoShardsMergedAreTheSingleSweepBitForBit) {
  const Plan plan = small_plan();
  run(plan, "single");
  merge({path("single")}, path("one"), true);
  run(plan, "two/shard-0-of-2", 0, 2);
  run(plan, "two/shard-1-of-2", 1, 2);
  merge({path("two")}, "", true);
  EXPECT_GT(text(path("one/points.csv")).size(), 500u);
  for (const char* file : {"points.csv", "fbmin.csv", "why.csv", "figure.svg"})
    EXPECT_EQ(text(path("one/") + file), text(path("two/") + file)) << file;
}

TEST_F(SweepTest, MergeRefusesAMissingADoubleAndAForeignPoint) {
  Plan plan = small_plan();
  plan.speeds_Hz = {200};
  run(plan, "a", 0, 2);
  run(plan, "b", 1, 2);
  EXPECT_THROW(merge({path("a")}, path("out"), true), BadInput);                        // missing
  EXPECT_THROW(merge({path("a"), path("b"), path("a")}, path("out"), true), BadInput);  // double
  plan.load_pu = 0.5;
  run(plan, "c", 1, 2);
  EXPECT_THROW(merge({path("a"), path("c")}, path("out"), true), BadInput);  // another sweep
  EXPECT_NO_THROW(merge({path("a"), path("b")}, path("out"), true));
}

TEST_F(SweepTest, AKilledSweepResumesAfterItsLastWholeLine) {
  Plan plan = small_plan();
  plan.speeds_Hz = {200};
  run(plan, "whole");
  merge({path("whole")}, path("expected"), true);
  const std::string points = text(path("expected/points.csv"));
  fs::create_directories(path("killed"));
  fs::copy(path("whole/sweep.json"), path("killed/sweep.json"));
  // Within the last figure of a row, which still reads as one.
  const std::size_t cut = points.find('\n', points.size() / 2) - 2;
  std::ofstream(path("killed/points.csv")) << points.substr(0, cut);
  run(plan, "killed");
  merge({path("killed")}, path("resumed"), true);
  EXPECT_EQ(text(path("resumed/points.csv")), points);
}

TEST_F(SweepTest, AResumedSweepMustBeTheSameSweep) {
  Plan plan = small_plan();
  plan.speeds_Hz = {200};
  run(plan, "a");
  plan.ramp_rad_s2 = 2000;
  EXPECT_THROW(run(plan, "a"), BadInput);
}

// The limit at 400 rad/s by three methods: the formula by hand from the gains logged in the docs,
// the Floquet radius, and the closed loop.
TEST(Why, FormulaFloquetAndTheDriveAgreeAtFourHundredRadPerSecond) {
  Config config = load_drive("dilys2021");
  const auto filter = make_filter(config);
  const Steady steady{filter, GainPolicy::kPaper, 100, 400, config.drive().T_s()};
  const double phi_c = critical_angle(steady, 12) * 180 / kPi;
  EXPECT_NEAR(phi_c, 79.2, 0.1);  // 78.6 with the other sign of k3d
  EXPECT_EQ(n_max_by_formula(steady, 100), 12);
  EXPECT_NEAR(n_max_by_floquet(steady, 100), 12, 1);
  EXPECT_LT(spectral_radius(steady, 1), 0.98);
  EXPECT_GT(spectral_radius(steady, 20), 1.05);
}

// A step that ends at a whole turn to the last bits: of two perturbed states, one is beyond it and is wrapped. With a
// gain that turns with the rotor every step turns the angle by the same.
TEST(Why, TheFloquetRadiusIsTheSameWhereTheAngleEndsATurn) {
  constexpr int kTurn = 80;  // ticks
  Config config = load_drive("dilys2021");
  const auto filter = make_filter(config);
  const double T_s = config.drive().T_s(), omega_e = kTwoPi / (kTurn * T_s);
  const Estimate begin = *filter->steady_state(omega_e / 4);
  const auto from = [&](double ticks) {
    return Steady{filter, GainPolicy::kRotorFrame,    omega_e / 4, omega_e, T_s,
                  1,      filter->ahead(begin, ticks)};
  };
  FastState state{.x_hat = begin.x_hat, .emf_angle = emf_angle_at(begin.theta_e, omega_e)};
  Measurement m{.signals = kPhaseCurrents | kVoltage};
  m.i_abc = inverse_clarke(inverse_park(begin.i_dq, begin.theta_e + omega_e * T_s));
  filter->fast_step(state, m, rotor_gains_of_period(from(0), kTurn)[0]);
  const double step = wrap_pi(state.x_hat[3]) / (omega_e * T_s);  // ticks
  EXPECT_NEAR(spectral_radius(from(-step), kTurn) / spectral_radius(from(0.5 - step), kTurn), 1,
              1e-3);
}

TEST(Why, TheControllerLimitsWhereTheClosedLoopHoldsLessByMoreThanAStepOrTenPercent) {
  EXPECT_EQ(limiting_part(8, 7, 100), "filter") << "one step";
  EXPECT_EQ(limiting_part(8, 6, 100), "controller");
  EXPECT_EQ(limiting_part(40, 36, 100), "filter") << "10 %";
  EXPECT_EQ(limiting_part(40, 35, 100), "controller");
  EXPECT_EQ(limiting_part(8, 12, 100), "filter");
  EXPECT_EQ(limiting_part(0, 12, 100), "-");
  EXPECT_EQ(limiting_part(12, 0, 100), "-");
  EXPECT_EQ(limiting_part(150, 100, 100), "-") << "every n that was tried";
}

TEST(Why, APropagatedGainHasNoLimit) {
  Config config = load_drive("dilys2021");
  const auto filter = make_filter(config);
  const Steady steady{filter, GainPolicy::kPropagated, 100, 400, config.drive().T_s(), 200};
  EXPECT_EQ(n_max_by_formula(steady, 100), 0);
  const double ordinary = spectral_radius({filter, GainPolicy::kPaper, 100, 400, 2e-4}, 1);
  for (int n : {1, 13, 100}) {
    EXPECT_LT(spectral_radius(steady, n), 1) << n;
    EXPECT_NEAR(std::pow(spectral_radius(steady, n), 1.0 / n), ordinary, 0.02) << n;
  }
}

// The lane engine does not cover this policy: the sweep uses the reference engine.
TEST_F(SweepTest, SweepsAPropagatedGain) {
  Plan plan = small_plan();
  plan.policies = {"propagated"};
  plan.speeds_Hz = {150};
  plan.seeds = 1;
  plan.n_max = 12;
  run(plan, "a");
  merge({path("a")}, path("whole"), true);
  EXPECT_NE(text(path("whole/fbmin.csv")).find("propagated,150,12,"), std::string::npos);
  EXPECT_NE(text(path("whole/why.csv")).find("both: no limit"), std::string::npos);
}

// Not in lanes, whose sine is their own: with that of the machine's library.
TEST_F(SweepTest, TheReferenceEngineHasTheSameLimitsOnEveryMachine) {
  Plan plan = small_plan();
  plan.engine = "reference";
  plan.seeds = 1;
  run(plan, "a");
  merge({path("a")}, path("whole"), true);
  const std::string limits = text(path("whole/fbmin.csv"));
  EXPECT_NE(limits.find("\npaper,150,6,"), std::string::npos) << limits;
  EXPECT_NE(limits.find("\npaper,200,4,"), std::string::npos) << limits;
}

// Kim's motor starts from any angle, but not with a gain every third tick; at speed it holds any n.
TEST_F(SweepTest, AStartThatLimitsIsCalledSo) {
  Plan plan = small_plan();
  plan.drive = "kim-ipmsm";
  plan.speeds_Hz = {20};
  plan.seeds = 1;
  plan.n_max = 20;
  plan.load_pu = 0;
  run(plan, "a");
  merge({path("a")}, path("whole"), true);
  EXPECT_NE(text(path("whole/why.csv")).find(",neither,22,start\n"), std::string::npos);
}

// The prediction is that of the load of the sweep, not of the drive file.
TEST_F(SweepTest, ALoadRaisesThePredictedLimitOfTheExtendedEmf) {
  Plan plan = small_plan();
  plan.drive = "kim-ipmsm";
  plan.overrides = {"estimator.kind=eemf", "controller.foc.synchronism.watch=false"};
  plan.speeds_Hz = {50};
  plan.start = "switched";
  plan.seeds = 1;
  plan.n_max = 15;
  plan.load_pu = 0.12;
  run(plan, "a");
  merge({path("a")}, path("whole"), true);
  EXPECT_NE(text(path("whole/why.csv")).find("paper,50,12,nan,0,12,"), std::string::npos);
}

// Formula and Floquet have a limit, above the cap.
TEST_F(SweepTest, APredictionAboveTheCapIsNoPredictionWithoutALimit) {
  Plan plan = small_plan();
  plan.speeds_Hz = {150};
  plan.seeds = 1;
  plan.n_max = 3;
  run(plan, "a");
  merge({path("a")}, path("whole"), true);
  EXPECT_NE(text(path("whole/why.csv")).find("both: above n_max"), std::string::npos);
  EXPECT_NE(text(path("whole/fbmin.csv")).find(",1,1\n"), std::string::npos);
}

TEST(Why, ATurnedGainHasNoLimit) {
  Config config = load_drive("dilys2021");
  const auto filter = make_filter(config);
  for (GainPolicy policy : {GainPolicy::kRotate, GainPolicy::kRotorFrame}) {
    const Steady steady{filter, policy, 100, 400, config.drive().T_s()};
    EXPECT_EQ(n_max_by_formula(steady, 100), 0);
    for (int n : {1, 13, 100, 1000}) EXPECT_LT(spectral_radius(steady, n), 1) << n;
  }
}

// Dilys 2021, Table 4, its 500 Hz row corrected: the printed 6.21 % is that of 1 kHz.
TEST(Cost, GivesThePapersTable) {
  const double expected[][2] = {
      {5000, 18.85}, {2500, 10.95}, {1250, 7.00}, {1000, 6.21}, {500, 4.63}};
  for (const auto& [f_b, percent] : expected)
    EXPECT_NEAR(100 * processor_share(Halves{}, 5000, f_b), percent, 0.006) << f_b;
  const std::string table = cost_table(Halves{}, {}, 5000, {500}, 7);
  EXPECT_NE(table.find("4.63"), std::string::npos);
  EXPECT_NE(table.find("nothing is counted here"), std::string::npos);
}

TEST(Cost, PrintsTheCountsOfTheFileAndHowTheyWereCounted) {
  const Counts counts{"by hand", "g++ 0", "abc", 30, 100, {{20, 2000}}};
  const std::string table = cost_table(Halves{}, counts, 5000, {500}, 7);
  EXPECT_NE(table.find(" 0.200\n"), std::string::npos) << table;  // 5000 x 30 + 500 x 100
  EXPECT_NE(table.find(" 3.000\n"), std::string::npos) << table;  // 250 x 6 x 2000
  EXPECT_NE(table.find("by hand\n(g++ 0, revision abc): fast 30, background 100"),
            std::string::npos);
  EXPECT_TRUE(read_counts(TWINRATE_SOURCE_DIR "/bench/results/instructions.json"));
  EXPECT_FALSE(read_counts(TWINRATE_SOURCE_DIR "/README.md"));
}

// Of the file that `cortex_m3 count` wrote, with its command.
TEST(Cost, PrintsTheCountsOfTheCortexM3) {
  const auto counts = read_cortex_counts(TWINRATE_SOURCE_DIR "/bench/results/cortex_m3.json");
  ASSERT_TRUE(counts);
  EXPECT_GT(counts->scheduled, counts->fast);
  const std::string table = cost_table(Halves{}, counts, 5000, {500}, 7);
  EXPECT_NE(table.find("emulated Cortex-M3, fixed point, by build/embedded/cortex_m3 count"),
            std::string::npos);
  EXPECT_EQ(table.find("propagated"), std::string::npos);
  EXPECT_FALSE(read_cortex_counts(TWINRATE_SOURCE_DIR "/bench/results/instructions.json"));
}

// n = 1: the radius is the largest pole of the filter's error, for every policy.
TEST(Why, WithAGainEveryTickEveryPolicyHasTheSameRadius) {
  Config config = load_drive("dilys2021");
  const auto filter = make_filter(config);
  const auto rho = [&](GainPolicy policy) {
    return spectral_radius({filter, policy, 100, 400, config.drive().T_s()}, 1);
  };
  const double ordinary = rho(GainPolicy::kPaper);
  EXPECT_GT(ordinary, 0.5);
  for (GainPolicy policy : {GainPolicy::kImmediate, GainPolicy::kExtrapolate, GainPolicy::kRotate,
                            GainPolicy::kRotorFrame})
    EXPECT_NEAR(rho(policy), ordinary, 1e-6);
  EXPECT_NEAR(rho(GainPolicy::kScheduled), ordinary, 1e-3);
}

// Searches of one policy at 50 Hz that held up to these n, one a seed.
std::vector<Point> held_up_to(const std::vector<int>& n_max) {
  std::vector<Point> points;
  for (std::size_t i = 0; i < n_max.size(); ++i)
    for (int n = 1; n <= n_max[i] + 1; ++n)
      points.push_back({.search = {"paper", 50, static_cast<int>(i) + 1},
                        .f_s_Hz = 5000,
                        .n = n,
                        .locked = n <= n_max[i],
                        .angle_error_rms = 0.01 * n});
  return points;
}

// By hand: f_bmin = 5000/8 Hz, ratio = f_bmin/50; the seed that held longest needs the fewest gains
// a turn, 5000/12/50, the one that was lost first the most, 5000/5/50.
TEST_F(SweepTest, TheLimitIsTheMiddleSeedsAndTheBoundsAreThoseOfTheOthers) {
  Plan plan = small_plan();
  plan.speeds_Hz = {50};
  plan.seeds = 3;
  write_limits(path("fbmin.csv"), limits_of(plan, held_up_to({12, 5, 8})));
  std::istringstream rows(text(path("fbmin.csv")));
  std::string row;
  std::getline(rows, row);
  std::getline(rows, row);
  std::vector<std::string> cells;
  std::istringstream in(row);
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  ASSERT_EQ(cells.size(), 11u) << row;
  EXPECT_EQ(cells[0], "paper");
  const double expected[] = {50, 8, 625, 12.5, 5000.0 / 12 / 50, 20, 0, 0.08, 3, 0};
  for (std::size_t i = 0; i < 10; ++i) EXPECT_NEAR(std::stod(cells[i + 1]), expected[i], 1e-9) << i;
}

TEST(Limits, OfAnEvenNumberOfSeedsTheLowerOfTheMiddleTwoCounts) {
  Plan plan = small_plan();
  plan.speeds_Hz = {50};
  plan.seeds = 4;
  const Limit limit = limits_of(plan, held_up_to({9, 3, 7, 6})).at(0);
  EXPECT_EQ(limit.n_max, 6);
  EXPECT_EQ(limit.n_lowest, 3);
  EXPECT_EQ(limit.n_highest, 9);
  EXPECT_NEAR(limit.angle_error_rms, 0.06, 1e-12) << "of n_max alone, where it held";
}

}  // namespace
}  // namespace twinrate::sweep
