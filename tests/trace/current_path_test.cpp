// Drops that follow the current, over its path from row to row.
#include <gtest/gtest.h>

#include <cmath>

#include "model/effects/shapes.hpp"
#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/equations.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

TEST(Shapes, AMeanOfTheCurrentsSignIsItsIntegral) {
  constexpr int kSteps = 20000;
  for (const CurrentShape shape :
       {CurrentShape::kClamp, CurrentShape::kTanh, CurrentShape::kAtan, CurrentShape::kRoot})
    for (const auto& [x, y] : {std::pair{-3.0, 5.0}, {0.4, 1.7}, {0.9998, 1.0002}, {-40.0, -2.0}}) {
      double sum = 0;
      for (int j = 0; j < kSteps; ++j) sum += current_sign(x + (y - x) * (j + 0.5) / kSteps, shape);
      EXPECT_NEAR(mean_current_sign(x, y, shape), sum / kSteps, 1e-6) << x << " to " << y;
      EXPECT_NEAR(mean_current_sign(y, x, shape), sum / kSteps, 1e-6) << y << " to " << x;
    }
}

// Where a phase current changes its sign, the mean of a dead time's drop over a row is not the mean
// of its ends. The currents at the rows are constant in rotor axes; between them a held voltage makes
// the flux straight in stator axes. Against a finer sum.
// Share of the magnets' flux, and allowed error.
class OfHeldVoltage : public testing::TestWithParam<std::pair<double, double>> {};
TEST_P(OfHeldVoltage, ADropThatFollowsTheCurrentIsAveragedOverIt) {
  DriveFacts facts = servo().facts();
  const MachineParameters& m = facts.machine;
  ASSERT_EQ(m.L_d, m.L_q);
  facts.machine.psi_f *= GetParam().first;
  constexpr double kTurn = 0.4, kCurrent = 5;  // rad electrical a row, A
  constexpr int kSteps = 2000;
  Health health;
  Record r = make_record(simulate_synthetic({.duration_s = 2}), 3, health);
  for (std::size_t k = 0; k < r.size(); ++k) {
    r.theta_m[k] = kTurn * static_cast<double>(k) / facts.machine.n_p;
    r.i_alphabeta[k] = inverse_park({0, kCurrent}, kTurn * static_cast<double>(k));
  }
  facts.T_s = r.T_s;
  const Equations equations(r, facts);
  const auto flux = [&](double row) {
    return inverse_park({m.psi_f, m.L_q * kCurrent}, kTurn * row);
  };
  const auto disagrees = [&](const std::shared_ptr<Effect>& effect, std::size_t regressor) {
    const Channels x = equations.columns(*effect)[regressor];
    std::vector<Contribution> at(static_cast<std::size_t>(effect->tracing().regressor_count()));
    double wrong = 0, size = 0;
    for (std::size_t k = 50; k < 150; ++k) {
      Vec2 mean = Vec2::Zero();
      for (int j = 0; j < kSteps; ++j) {
        OperatingPoint p = equations.points()[k];
        const double share = (j + 0.5) / kSteps, row = static_cast<double>(k);
        p.theta_e = kTurn * (row + share);
        p.theta_m = p.theta_e / facts.machine.n_p;
        p.d_axis = {std::cos(p.theta_e), std::sin(p.theta_e)};
        const Vec2 psi = (1 - share) * flux(row) + share * flux(row + 1);
        p.i_dq = (park(psi, p.theta_e) - Vec2(m.psi_f, 0)) / m.L_d;
        effect->tracing().regressors(p, at);
        mean += p.stator_axes(at[regressor].u_dq_drop) / kSteps;
      }
      const Vec2 dq = park(mean, kTurn * (static_cast<double>(k) + 0.5));
      wrong += (Vec2(x.d[k], x.q[k]) - dq).squaredNorm();
      size += dq.squaredNorm();
    }
    return std::sqrt(wrong / size);
  };
  const auto dead_time = make_effect("dead_time"), drop = make_effect("inverter_drop");
  for (const auto& effect : {dead_time, drop}) {
    set_key(*effect, "linear_current_A", 0.1);
    ASSERT_EQ(effect->prepare(facts), "");
  }
  const double allowed = GetParam().second;
  EXPECT_LT(disagrees(dead_time, 0), allowed);
  EXPECT_LT(disagrees(drop, 0), allowed);
  EXPECT_LT(disagrees(drop, 1), allowed);
}
// By the currents at the rows alone: 0.012 without magnets (the third), 0.019 and 0.092 with them.
INSTANTIATE_TEST_SUITE_P(Path, OfHeldVoltage,
                         testing::Values(std::pair(0.0, 2e-3), std::pair(0.2, 1e-2),
                                         std::pair(1.0, 5e-2)));

// A ripple of the sixth harmonic, 0.8 rad a row, is in the path; noise of the same size is smoothed.
// Against the columns of the current without noise.
TEST(Path, KeepsARippleAndSmoothsNoise) {
  DriveFacts facts = servo().facts();
  facts.machine.psi_f = 0;
  constexpr double kTurn = 0.8 / 6, kSize = 0.1;  // rad electrical a row; A, rms
  Health health;
  Record plain = make_record(simulate_synthetic({.duration_s = 2}), 3, health);
  facts.T_s = plain.T_s;
  const auto with = [&](const auto& added) {
    Record r = plain;
    for (std::size_t k = 0; k < r.size(); ++k) {
      const double theta_e = kTurn * static_cast<double>(k);
      r.theta_m[k] = theta_e / facts.machine.n_p;
      r.i_alphabeta[k] = inverse_park(Vec2(0, 1) + added(k, theta_e), theta_e);
    }
    return r;
  };
  const auto column = [&](const Record& r) {
    const auto dead_time = make_effect("dead_time");
    set_key(*dead_time, "linear_current_A", 0.3);
    EXPECT_EQ(dead_time->prepare(facts), "");
    return Equations(r, facts).columns(*dead_time)[0];
  };
  const auto apart = [](const Channels& a, const Channels& b) {
    double sum = 0;
    for (std::size_t k = 50; k + 50 < a.d.size(); ++k)
      sum += (Vec2(a.d[k], a.q[k]) - Vec2(b.d[k], b.q[k])).squaredNorm();
    return std::sqrt(sum / static_cast<double>(a.d.size() - 100));
  };
  const auto ripple = [&](std::size_t, double theta_e) {
    return Vec2(std::sqrt(2.0) * kSize * std::sin(6 * theta_e), 0);
  };
  const auto noise = [&](std::size_t k, double) {
    return Vec2(kSize * normal(1, 1, k), kSize * normal(1, 2, k));
  };
  const Channels still = column(with([](std::size_t, double) { return Vec2(0, 0); }));
  const double of_ripple = apart(column(with(ripple)), still),
               of_noise = apart(column(with(noise)), still);
  EXPECT_GT(of_ripple, 2 * of_noise);  // 2.4; all smoothed 0.9, nothing smoothed 1.5
}

}  // namespace
}  // namespace twinrate
