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

// An angle's noise, differenced twice, beside `share` of its power of other noise.
Eigen::VectorXd noise_of_angle(Eigen::Index n, double share) {
  Eigen::VectorXd y(n);
  const auto angle = [](Eigen::Index k) { return normal(5, 0, static_cast<std::uint64_t>(k)); };
  for (Eigen::Index k = 0; k < n; ++k)
    y[k] = angle(k + 2) - 2 * angle(k + 1) + angle(k) +
           std::sqrt(share) * normal(5, 1, static_cast<std::uint64_t>(k));
  return y;
}

TEST(AngleNoise, IsFoundAndMadeWhite) {
  constexpr Eigen::Index n = 20000;
  const Eigen::VectorXd y = noise_of_angle(n, 1e-3);
  Runs runs = one_run(n);
  runs.start = {0, 40, 300};
  const AngleNoise angle = AngleNoise::of(y, runs, 1e-3);
  ASSERT_FALSE(angle.none());
  EXPECT_NEAR(std::log10(angle.w_over_s()), -3, 0.6);
  const Eigen::VectorXd e = AngleNoise(1e-3)(y, runs);
  EXPECT_GT(whiteness_p_value(e, runs), 1e-3);
  // From the first value of a run on the innovations are as large.
  for (const auto& [first, count] : {std::pair<Eigen::Index, Eigen::Index>{0, 300}, {300, 19700}})
    EXPECT_NEAR(
        e.segment(first, count).squaredNorm() / static_cast<double>(count) / (e.squaredNorm() / n),
        1, count < 1000 ? 0.35 : 0.05);
  // White noise is left to the autoregression.
  Eigen::VectorXd white(n);
  for (Eigen::Index k = 0; k < n; ++k) white[k] = normal(6, 0, static_cast<std::uint64_t>(k));
  EXPECT_TRUE(AngleNoise::of(white, runs, 1e-3).none());
}

// What a constant torque is worth against such noise: an autoregression alone takes the noise for
// louder at low frequencies than it is.
TEST(AngleNoise, LetsALoadBeSeen) {
  constexpr Eigen::Index n = 20000;
  constexpr double kShare = 1e-5;
  const Eigen::VectorXd y = noise_of_angle(n, kShare), load = Eigen::VectorXd::Ones(n);
  const Runs runs = one_run(n);
  const AngleNoise angle = AngleNoise::of(y, runs, 1e-3);
  const Whitener plain(y, runs), better(angle(y, runs), runs, angle, 0);
  // In the limit 1 / w a value.
  EXPECT_GT(better(load, runs).norm(), 0.8 * std::sqrt(n / kShare));
  EXPECT_LT(plain(load, runs).norm(), 0.4 * better(load, runs).norm());
  const double t = better(load, runs).dot(better(y, runs)) / better(load, runs).norm();
  EXPECT_LT(std::abs(t), 4);
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
