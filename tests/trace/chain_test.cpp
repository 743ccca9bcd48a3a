// The parts of the chain against closed forms.
#include <gtest/gtest.h>

#include "model/random.hpp"
#include "trace/keys.hpp"
#include "trace/statistics.hpp"
#include "trace/whitening.hpp"

namespace twinrate {
namespace {

Runs one_run(std::size_t n) {
  Runs runs;
  runs.start = {0};
  for (std::size_t k = 0; k < n; ++k) runs.row.push_back(k);
  runs.held_out.assign(n, 0);
  return runs;
}

TEST(Whitener, FindsTheCoefficientsOfAnAutoregression) {
  constexpr Eigen::Index n = 20000;
  Eigen::VectorXd y(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double e = 0.7 * normal(3, 0, static_cast<std::uint64_t>(k));
    y[k] = e + (k > 0 ? 1.2 * y[k - 1] : 0) - (k > 1 ? 0.5 * y[k - 2] : 0);
  }
  const Runs runs = one_run(static_cast<std::size_t>(n));
  const Whitener whitener(y, runs);
  EXPECT_NEAR(whitener.sigma(), 0.7, 0.02);
  const Eigen::VectorXd e = whitener(y, runs);
  EXPECT_NEAR(e.squaredNorm() / n, 1, 0.03);
  EXPECT_GT(whiteness_p_value(e, runs), 1e-3);
  EXPECT_LT(whiteness_p_value(y, runs), 1e-12);
}

TEST(Whitener, ItsOwnNoiseIsWhiteAndAPeriodicSignalIsNot) {
  constexpr Eigen::Index n = 10000;
  Eigen::VectorXd noise(n), both(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const double e = normal(4, 0, static_cast<std::uint64_t>(k));
    noise[k] = e + (k > 0 ? 1.2 * noise[k - 1] : 0) - (k > 1 ? 0.5 * noise[k - 2] : 0);
    both[k] = noise[k] + (k % 50 == 0 ? 3 : 0);
  }
  const Runs runs = one_run(static_cast<std::size_t>(n));
  const auto p_value = [&](const Eigen::VectorXd& y) {
    return whiteness_p_value(Whitener(y, runs, 40)(y, runs), runs, 60, 40);
  };
  EXPECT_GT(p_value(noise), 1e-3);
  EXPECT_LT(p_value(noise), 0.999);
  EXPECT_LT(p_value(both), 1e-6);
}

TEST(Statistics, ChiSquareTailAgainstTables) {
  EXPECT_NEAR(chi_square_tail(3.841, 1), 0.05, 1e-4);
  EXPECT_NEAR(chi_square_tail(18.307, 10), 0.05, 1e-4);
  EXPECT_NEAR(chi_square_tail(37.566, 20), 0.01, 1e-4);
  EXPECT_EQ(chi_square_tail(0, 3), 1);
}

TEST(Keys, AreReadAndSetInsideTheirRange) {
  const auto effect = make_effect("cogging");
  EXPECT_TRUE(set_key(*effect, "amplitude_Nm", 0.2));
  EXPECT_EQ(get_key(*effect, "amplitude_Nm"), 0.2);
  EXPECT_FALSE(set_key(*effect, "amplitude_Nm", -1));
  EXPECT_EQ(get_key(*effect, "amplitude_Nm"), 0);
  EXPECT_THROW(set_key(*effect, "no_such_key", 1), std::logic_error);
}

}  // namespace
}  // namespace twinrate
