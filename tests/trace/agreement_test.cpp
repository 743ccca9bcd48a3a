#include "trace/agreement.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/trace/fitted_drive.hpp"

namespace twinrate {

// At a constant speed the column of an inertia is noise, and its coefficient says nothing.
TEST(Agreement, APartInWhichAClaimIsMostlyNoiseIsNotCompared) {
  Eigen::MatrixXd x(200, 1);
  for (Eigen::Index k = 0; k < x.rows(); ++k) x(k, 0) = std::sin(0.1 * static_cast<double>(k));
  const Eigen::VectorXd small = Eigen::VectorXd::Constant(x.rows(), 1e-3), y = x.col(0) + small;
  const PartSums part(x, y), opposite(x, small - x.col(0));
  PartSums noisy = opposite;
  const auto compared = [&](const PartSums& from, const PartSums& on) {
    Agreement out;
    compare_parts(from, on, {1}, 16, "two parts", out);
    return std::pair(out.compared, out.kept);
  };
  EXPECT_EQ(compared(opposite, part).first, 1);
  EXPECT_LT(compared(opposite, part).second, 0);
  noisy.noise[0] = 0.4 * noisy.A(0, 0);
  EXPECT_EQ(compared(noisy, part).first, 1);
  noisy.noise[0] = 0.6 * noisy.A(0, 0);
  EXPECT_EQ(compared(noisy, part).first, 0);
  EXPECT_EQ(compared(part, noisy).first, 0);
}

// The second coefficient is -3 in one part and 1 in the other. A part that hardly moves it is wrong
// about it by many of its standard deviations, and says nothing of its size.
TEST(Agreement, ADirectionThatAPartHardlyKnowsIsNotCompared) {
  const auto part = [](double moves, double second) {
    Eigen::MatrixXd x(400, 2);
    Eigen::VectorXd error(x.rows());
    for (Eigen::Index k = 0; k < x.rows(); ++k) {
      const double t = 0.1 * static_cast<double>(k);
      x(k, 0) = std::sin(t), x(k, 1) = moves * std::cos(2.3 * t),
           error[k] = 0.01 * std::cos(31 * t);
    }
    return PartSums(x, x * Eigen::Vector2d(1, second) + error);
  };
  const auto compared = [&](double moves) {
    Agreement out;
    compare_parts(part(moves, -3), part(1, 1), {1, 1}, 16, "two parts", out);
    return std::pair(out.compared, out.kept);
  };
  EXPECT_EQ(compared(0.03).first, 1);
  EXPECT_GT(compared(0.03).second, 0.9);
  EXPECT_LT(compared(0.3).second, 0);
  Agreement none;
  compare_parts(part(0.03, -3), part(1, 1), {0, 1}, 16, "two parts", none);
  EXPECT_EQ(none.compared, 0) << "no direction is left";
}

// Of two offsets only the difference shows: 1 and 0 predict what 6 and 5 do, and twice what 5.5 and 5 do.
TEST(Agreement, SizesAreComparedInWhatTheyPredict) {
  Eigen::Matrix2d A;
  A << 1, -1, -1, 1;
  const Eigen::Vector2d one(1, 0);
  EXPECT_DOUBLE_EQ(predicted_ratio(A, one, Eigen::Vector2d(6, 5)), 1);
  EXPECT_DOUBLE_EQ(predicted_ratio(A, one, Eigen::Vector2d(5.5, 5)), 0.5);
  EXPECT_DOUBLE_EQ(predicted_ratio(A, one, Eigen::Vector2d(5, 6)), -1);
}

// 400 periods a turn are 2.8 kHz at the highest speed. Rows of 0.4 ms do not hold them, and a column of
// these rows folds them to a low frequency.
TEST(Agreement, ALineIsComparedWhereTheRowsHoldIt) {
  SyntheticDrive drive{.duration_s = 3};
  drive.extra_load = [](double, double theta, double) { return 0.3 * std::sin(400 * theta); };
  const RawLog raw = simulate_synthetic(drive);
  const Members line = {
      effect_with("cogging", {{"order", 400.}, {"amplitude_Nm", 0.3}, {"phase_rad", 0.}})};
  const FittedDrive whole(raw, line, {}, 2), half(raw, line, {}, 4);
  const Agreement found = Parts(whole.chain(), line, &half.chain()).of(0, 4);
  EXPECT_GE(found.compared, 3);
  EXPECT_GT(found.kept, 0.5) << found.between;
}

}  // namespace twinrate
