// The design mathematics against geometry and least squares; building blocks within the bench.
#include "trace/plan.hpp"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>

#include "core/config.hpp"
#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/plan_blocks.hpp"
#include "trace/plan_information.hpp"

namespace twinrate {
namespace {

double largest(const Eigen::VectorXd& c) {
  return c.cwiseAbs().maxCoeff();
}

PlanGroup group(std::size_t kind, Eigen::Index first, Eigen::Index count) {
  return {kind, first, count, largest, smallest_of(largest, count)};
}

Information information_of(const Eigen::MatrixXd& X) {
  return {X.transpose() * X, Eigen::VectorXd::Zero(X.cols()), static_cast<double>(X.rows())};
}

Eigen::MatrixXd noise_matrix(Eigen::Index rows, Eigen::Index columns, std::uint64_t seed) {
  Eigen::MatrixXd X(rows, columns);
  for (Eigen::Index c = 0; c < columns; ++c)
    for (Eigen::Index r = 0; r < rows; ++r)
      X(r, c) = normal(seed, static_cast<std::uint64_t>(c), static_cast<std::uint64_t>(r));
  return X;
}

// Two columns of lengths 30 and 7 at an angle.
Information at_angle(double phi) {
  Eigen::MatrixXd X = Eigen::MatrixXd::Zero(1000, 2);
  X(0, 0) = 30;
  X(0, 1) = 7 * std::cos(phi);
  X(1, 1) = 7 * std::sin(phi);
  return information_of(X);
}

TEST(Plan, GivesTheAngleOfTwoColumns) {
  const PlanCandidates two{{"a", "b"}, {group(0, 0, 1), group(1, 1, 1)}, 2};
  for (double phi : {0.05, 0.4, 1.2}) {
    const auto k = outlook(at_angle(phi), two);
    EXPECT_NEAR(k[0].alone, 30, 1e-6);
    EXPECT_NEAR(k[1].alone, 7, 1e-6);
    EXPECT_NEAR(k[0].beside[1], 30 * std::sin(phi), 1e-4);
    EXPECT_NEAR(k[1].beside[0], 7 * std::sin(phi), 1e-4);
    EXPECT_NEAR(k[0].beside_all, 30 * std::sin(phi), 2e-2);
    EXPECT_NEAR(k[0].sine[1], std::sin(phi), 1e-5);
    EXPECT_EQ(k[0].nearest, 1u);
  }
}

TEST(Plan, ApartIsFourSigmasOrTwoPerCentOfTheGain) {
  const PlanCandidates two{{"a", "b"}, {group(0, 0, 1), group(1, 1, 1)}, 2};
  // N log(1 + d^2/N) = 16 where d is a little above 4.
  const double four = std::sqrt(1000 * std::expm1(16.0 / 1000));
  EXPECT_TRUE(outlook(at_angle(std::asin(1.01 * four / 30)), two)[0].separated());
  EXPECT_FALSE(outlook(at_angle(std::asin(0.99 * four / 30)), two)[0].separated());
  // For a large effect 2 % of the gain are the limit.
  Information large = at_angle(0.1);
  large.M *= 1e4;
  large.rows *= 1e4;
  EXPECT_GT(outlook(large, two)[0].beside[1], 200);
  EXPECT_FALSE(outlook(large, two)[0].separated());
  const double share = 0.02 * std::log1p(0.9) / std::log1p(0.9 * std::pow(std::sin(0.1), 2));
  EXPECT_NEAR(outlook(large, two)[0].clear[1], 4 / std::sqrt(share), 1e-3);
}

TEST(Plan, TheClearPartIsTheLeastSquaresResidual) {
  Eigen::MatrixXd X = noise_matrix(400, 5, 3);
  X.col(3) += 0.8 * X.col(0);
  X.col(4) += 0.5 * X.col(1) - X.col(0);
  const PlanCandidates two{{"a", "b"}, {group(0, 0, 3), group(1, 3, 2)}, 5};
  const Eigen::MatrixXd A = X.leftCols(3), B = X.rightCols(2);
  const Eigen::MatrixXd rest = A - B * B.colPivHouseholderQr().solve(A);
  const double mean = rest.norm() / std::sqrt(3.0);
  EXPECT_NEAR(outlook(information_of(X), two)[0].beside[1], mean, 1e-4 * mean);
}

TEST(Plan, AKindThatHoldsAnotherImitatesItAndNotTheOtherWayRound) {
  const Eigen::MatrixXd x = noise_matrix(300, 2, 5);
  Eigen::MatrixXd X(300, 3);
  X << x.col(0), x.col(0), x.col(1);
  const PlanCandidates two{{"small", "large"}, {group(0, 0, 1), group(1, 1, 2)}, 3};
  const auto k = outlook(information_of(X), two);
  EXPECT_LT(k[0].beside[1], 1e-2);
  EXPECT_FALSE(k[0].separated());
  EXPECT_NEAR(k[1].beside[0], std::sqrt(300.0 / 2), 2);
  EXPECT_TRUE(k[1].separated());
}

TEST(Plan, ColumnsThatDoNothingTogetherDoNotHideTheRest) {
  Eigen::MatrixXd X = noise_matrix(500, 3, 7);
  X.col(2) = -X.col(0) - X.col(1);
  const PlanCandidates one{{"a"}, {group(0, 0, 3)}, 3};
  const double alone = outlook(information_of(X), one)[0].alone;
  EXPECT_GT(alone, 15);
  EXPECT_LT(alone, 60);
  // A column of pure noise has no weight.
  Information noisy = information_of(X);
  noisy.noise.setConstant(1e6);
  EXPECT_EQ(outlook(noisy, one)[0].alone, 0);
}

TEST(Plan, TheSmallestEffectHasSizeOne) {
  const auto amplitude = [](const Eigen::VectorXd& c) { return c.norm() / 0.004; };
  EXPECT_NEAR(smallest_of(amplitude, 2)[1], 0.004, 1e-9);
  const auto square = [](const Eigen::VectorXd& c) { return std::sqrt(std::abs(c[0])) / 3; };
  EXPECT_NEAR(smallest_of(square, 1)[0], 9, 1e-6);
  // Only differences matter.
  const auto uneven = [](const Eigen::VectorXd& c) {
    return (c.array() - c.mean()).abs().maxCoeff();
  };
  EXPECT_NEAR(smallest_of(uneven, 3)[2], 1.5, 1e-9);
  EXPECT_EQ(smallest_of([](const Eigen::VectorXd&) { return 0.0; }, 2).norm(), 0);
}

TEST(Plan, ChoosesWhatSeparatesBeforeWhatRepeats) {
  const PlanCandidates two{{"a", "b"}, {group(0, 0, 1), group(1, 1, 1)}, 2};
  const Information aliased = at_angle(0), apart = at_angle(1.4);
  const std::vector<PlanPiece> pieces = {{aliased, 1}, {apart, 1.5}, {apart, 3}};
  PlanSettings settings{.longest_s = 5};
  const auto order = choose(pieces, aliased, two, settings);
  ASSERT_FALSE(order.empty());
  EXPECT_EQ(order[0], 1u);
  double seconds = 0;
  for (std::size_t p : order) seconds += pieces[p].duration_s;
  EXPECT_LE(seconds, 5);
  settings.longest_s = 0.5;
  EXPECT_TRUE(choose(pieces, aliased, two, settings).empty());
  // An effect that is already separated needs no run.
  settings.longest_s = 5;
  EXPECT_TRUE(choose(pieces, 1e4 * apart, two, settings).empty());
  settings.stop = [] { return true; };
  EXPECT_TRUE(choose(pieces, aliased, two, settings).empty());
}

TEST(Plan, AnExcerptHasTheInformationOfALongRecord) {
  const Config config = Config::parse(Config::load("niewiara2020").resolved_with({}), "test");
  SyntheticDrive drive;
  drive.duration_s = 16;
  Health health;
  const Record whole = make_record(simulate_synthetic(drive), 3, health);
  double part = 0;
  EXPECT_EQ(excerpt(whole, 20, part).size(), whole.size());
  EXPECT_EQ(part, 1);
  const Record some = excerpt(whole, 8, part);
  EXPECT_NEAR(part, 0.5, 1e-3);
  const std::set<std::string> kinds = {"coulomb_friction", "viscous_friction", "resistance"};
  const auto look = [&](const Record& record, double factor) {
    const PlanInformation x =
        plan_information(record, health, config.drive(), kinds, {{0, record.size()}});
    return outlook(factor * x.pieces.at(0), x.candidates);
  };
  const auto all = look(whole, 1), half = look(some, 1 / part);
  ASSERT_EQ(all.size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_GT(all[k].alone, 10);
    EXPECT_NEAR(half[k].alone / all[k].alone, 1, 0.25);
  }
}

using Steps = std::vector<ProfileStep>;

void inside(const Steps& steps, double limit, bool negative_too) {
  ASSERT_FALSE(steps.empty());
  EXPECT_EQ(steps.front().t_s, 0);
  EXPECT_EQ(steps.back().value, 0);
  for (std::size_t j = 0; j < steps.size(); ++j) {
    EXPECT_LE(std::abs(steps[j].value), limit * (1 + 1e-9));
    if (!negative_too) {
      EXPECT_GE(steps[j].value, 0);
    }
    if (j > 0) {
      EXPECT_GT(steps[j].t_s, steps[j - 1].t_s);
    }
  }
}

TEST(PlanBlocks, StayInsideTheBenchAndEndAtRest) {
  for (const std::string& preset : preset_names()) {
    const Config config = Config::load(preset);
    Bench bench = bench_of(config.drive(), 3.0);
    EXPECT_GT(bench.omega_m_max, 0) << preset;
    EXPECT_GT(bench.slew, 0) << preset;
    EXPECT_LE(bench.i_max, 3.0) << preset;
    for (bool reverse : {true, false}) {
      bench.reverse = reverse;
      const auto blocks = building_blocks(bench);
      std::vector<std::size_t> order;
      for (const PlanBlock& block : blocks) {
        SCOPED_TRACE(preset + ", " + block.name);
        inside(block.omega_m, bench.omega_m_max, reverse);
        inside(block.T_load, bench.T_load_max, true);
        inside(block.i_d, bench.i_max, true);
        for (const Steps* steps : {&block.omega_m, &block.T_load, &block.i_d})
          EXPECT_LT(steps->back().t_s, block.duration_s);
        order.push_back(order.size());
        order.push_back(order.size() / 2);
      }
      order.resize(blocks.size());
      const PlanProfile all = assemble(blocks, order);
      inside(all.omega_m, bench.omega_m_max, reverse);
      EXPECT_EQ(all.start_s.size(), order.size());
    }
  }
}

TEST(PlanBlocks, WithoutALoadMachineThereIsNoLoad) {
  const Config config = Config::load("niewiara2020");
  Bench bench = bench_of(config.drive(), 0);
  const std::size_t with = building_blocks(bench).size();
  bench.T_load_max = 0;
  const auto blocks = building_blocks(bench);
  EXPECT_LT(blocks.size(), with);
  for (const PlanBlock& block : blocks) EXPECT_EQ(block.T_load.size(), 1u) << block.name;
}

}  // namespace
}  // namespace twinrate
