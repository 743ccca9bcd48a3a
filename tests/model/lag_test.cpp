#include "model/effects/lag.hpp"

#include <gtest/gtest.h>

#include <complex>

#include "model/effects/memory.hpp"
#include "model/random.hpp"
#include "tests/support/effects.hpp"

namespace twinrate {
namespace {

constexpr double kTs = 1e-4;
using Complex = std::complex<double>;

// Gain and phase at `omega` in steady state: the fundamental over whole periods.
template <class Line>
Complex response(Line line, int samples_a_period) {
  const double omega = kTwoPi / (samples_a_period * kTs);
  Complex in = 0, out = 0;
  for (int k = 0; k < 60 * samples_a_period; ++k) {
    const double x = std::sin(omega * k * kTs), y = line.pass(x);
    if (k < 50 * samples_a_period) continue;
    in += x * std::polar(1.0, -omega * k * kTs);
    out += y * std::polar(1.0, -omega * k * kTs);
  }
  return out / in;
}

TEST(DelayLine, TurnsASineBackByOmegaTimesTheDelay) {
  for (double delay : {0.0, 3e-5, 1e-4, 2.5e-4, 7.3e-4}) {
    const Complex H = response(DelayLine<double>(delay, kTs), 200);
    EXPECT_NEAR(std::arg(H), -kTwoPi * 50 * delay, 2e-5) << delay;
    EXPECT_NEAR(std::abs(H), 1, 2e-4);
  }
}

TEST(DelayLine, OfWholeSamplesGivesBackTheSamplesThemselves) {
  DelayLine<double> line(3 * kTs, kTs), by_count(3);
  for (std::uint64_t k = 0; k < 50; ++k) {
    const double x = normal(1, 0, k);
    const double expected = normal(1, 0, k < 3 ? 0 : k - 3);
    EXPECT_NEAR(line.pass(x), expected, 1e-9);
    EXPECT_EQ(by_count.pass(x), expected);
  }
}

TEST(LowPass, HasTheGainAndPhaseOfAFirstOrderFilter) {
  for (double tau : {5e-5, 3e-4, 1e-3, 5e-3}) {
    const Complex H = response(LowPass<double>(tau, kTs), 200);
    const Complex expected = 1.0 / Complex(1, kTwoPi * 50 * tau);
    EXPECT_NEAR(std::abs(H - expected), 0, 2e-4) << tau;
  }
}

TEST(HeldLowPass, GivesTheMeanOverTheSampleOfTheFilteredStaircase) {
  constexpr double kTau = 7e-5;
  constexpr int kFine = 2000;
  HeldLowPass<double> line(kTau, kTs);
  double v = normal(2, 0, 0);  // oracle: small steps
  for (std::uint64_t k = 0; k < 30; ++k) {
    const double u = normal(2, 0, k);
    double mean = 0;
    for (int j = 0; j < kFine; ++j) {
      const double h = kTs / kFine, middle = v + 0.5 * h * (u - v) / kTau;
      mean += middle / kFine;
      v += h * (u - middle) / kTau;
    }
    EXPECT_NEAR(line.pass(u), mean, 1e-6);
  }
}

// A record at constant speed with a rotating current and a voltage of its own for every sample.
std::vector<OperatingPoint> record(double omega_m) {
  std::vector<OperatingPoint> points;
  for (std::uint64_t k = 0; k < 400; ++k) {
    OperatingPoint p{.t = 1e-4 * static_cast<double>(k),
                     .i_dq = Vec2(1, 2),
                     .u_dq = Vec2(10 * normal(3, 0, k), 10 * normal(3, 1, k)),
                     .omega_m = omega_m * (1 + 0.1 * std::sin(0.02 * static_cast<double>(k)))};
    p.theta_m = (k ? points.back().theta_m : 0.0) + kTs * p.omega_m;
    p.theta_e = 3 * p.theta_m;
    points.push_back(p);
  }
  return points;
}

std::vector<Contribution> along(int signal, int form, double lag,
                                const std::vector<OperatingPoint>& points) {
  const auto effect =
      test::effect_of("signal_lag", {{"signal", signal}, {"form", form}, {"lag_s", lag}});
  std::vector<Contribution> sums(points.size());
  contributions(*effect, points, kTs, sums);
  return sums;
}

TEST(SignalLag, OfTheVoltageIsWhatIsAskedLessAMixWithTheSampleBeforeInStatorAxes) {
  const auto points = record(20);
  const auto sums = along(0, 0, 3e-5, points);
  for (std::size_t k = 1; k < points.size(); ++k) {
    const Vec2 now = inverse_park(points[k].u_dq, points[k].theta_e);
    const Vec2 before = inverse_park(points[k - 1].u_dq, points[k - 1].theta_e);
    const Vec2 drop = inverse_park(sums[k].u_dq_drop, points[k].theta_e);
    EXPECT_NEAR((drop - 0.3 * (now - before)).norm(), 0, 1e-9);
  }
}

TEST(SignalLag, OfTheCurrentTurnsTheVectorBackByTheElectricalAngleOfTheLag) {
  const auto points = record(20);
  for (int form : {0, 1}) {
    const auto sums = along(1, form, 2e-4, points);
    for (std::size_t k = 100; k < points.size(); k += 37) {
      const Vec2 reading = park(clarke(points[k].i_abc() + sums[k].i_abc), points[k].theta_e);
      const double turned = -3 * points[k].omega_m * 2e-4;  // 12 mrad
      EXPECT_NEAR((reading - rotate(points[k].i_dq, turned)).norm(), 0, 1e-3);
      EXPECT_GT((reading - points[k].i_dq).norm(), 0.02);
    }
  }
}

TEST(SignalLag, OfTheAngleIsSpeedTimesLagAlsoWhereTheAngleIsWrapped) {
  auto points = record(50);
  const auto unwrapped = along(2, 0, 1.5e-4, points);
  for (OperatingPoint& p : points) p.theta_m = wrap_turn(p.theta_m);
  const auto wrapped = along(2, 0, 1.5e-4, points);
  for (std::size_t k = 5; k < points.size(); ++k) {
    EXPECT_NEAR(unwrapped[k].theta_m, -1.5e-4 * points[k].omega_m, 2e-5);
    EXPECT_NEAR(wrapped[k].theta_m, unwrapped[k].theta_m, 1e-12);
  }
}

TEST(SignalLag, OfTheSpeedIsItsSlopeTimesTheLag) {
  const auto points = record(50);
  for (int form : {0, 1}) {
    const auto sums = along(3, form, 1e-3, points);
    for (std::size_t k = 150; k < points.size(); k += 29) {
      const double slope = (points[k].omega_m - points[k - 20].omega_m) / (20 * kTs);
      EXPECT_NEAR(sums[k].omega_m, -1e-3 * slope, 0.15);  // curvature: 0.1 x 50 x 200^2 x 1e-6
      EXPECT_EQ(sums[k].theta_m, 0);
    }
  }
}

TEST(SignalLag, IsSmoothInTheLag) {
  const auto points = record(20);
  const auto size = [](const std::vector<Contribution>& sums) {
    double sum = 0;
    for (const Contribution& c : sums) sum += test::flat(c).squaredNorm();
    return std::sqrt(sum);
  };
  for (int signal : {0, 1, 2, 3}) {
    for (int form : {0, 1}) {
      const double lag = 1.37e-4, h = 1e-6;
      const auto less = along(signal, form, lag - h, points);
      const auto there = along(signal, form, lag, points);
      auto slope = along(signal, form, lag + h, points), bend = slope;
      for (std::size_t k = 0; k < points.size(); ++k) {
        const test::Flat values = test::flat(slope[k]) - test::flat(less[k]);
        const test::Flat second =
            test::flat(slope[k]) + test::flat(less[k]) - 2 * test::flat(there[k]);
        slope[k] = {.T_load = values.norm()};
        bend[k] = {.T_load = second.norm()};
      }
      EXPECT_GT(size(slope), 0);
      EXPECT_LT(size(bend), 0.02 * size(slope)) << signal << form;
    }
  }
}

}  // namespace
}  // namespace twinrate
