// Thinning of rows keeps the residuals of the equations.
#include "trace/thinning.hpp"

#include <gtest/gtest.h>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/equations.hpp"
#include "trace/keys.hpp"
#include "trace/record_contributions.hpp"

namespace twinrate::thinning_test {

// The declared machine, accelerating at 2000 rad/s electrical, without noise, rows T_s apart. The
// voltage is that of the declared equations, constant over each row: the flux is linear in time,
// the magnets rotate, and the current follows from both.
Record fast_record(double T_s, std::size_t rows) {
  const MachineParameters& m = servo().machine;
  Record r;
  r.T_s = T_s;
  std::vector<Vec2> psi;
  for (std::size_t k = 0; k <= rows; ++k) {
    const double t = static_cast<double>(k) * T_s;
    const double theta_m = (2000.0 / m.n_p) * t + 0.5 * 400 * t * t;
    const Vec2 i_dq(0.5 * std::sin(40 * t), 2 + std::sin(90 * t));
    r.t.push_back(t);
    r.theta_m.push_back(theta_m);
    r.i_alphabeta.push_back(inverse_park(i_dq, m.n_p * theta_m));
    psi.push_back(inverse_park({m.psi_f + m.L_d * i_dq[0], m.L_q * i_dq[1]}, m.n_p * theta_m));
  }
  EXPECT_EQ(m.L_d, m.L_q);
  constexpr int kParts = 50;
  for (std::size_t k = 0; k < rows; ++k) {
    Vec2 i_mean = Vec2::Zero();
    for (int j = 0; j < kParts; ++j) {
      const double x = (j + 0.5) / kParts;
      const double theta_m = r.theta_m[k] + x * (r.theta_m[k + 1] - r.theta_m[k]);
      const Vec2 magnets = inverse_park({m.psi_f, 0}, m.n_p * theta_m);
      i_mean += (psi[k] + x * (psi[k + 1] - psi[k]) - magnets) / (m.L_d * kParts);
    }
    r.u_alphabeta.push_back((psi[k + 1] - psi[k]) / T_s + m.R_s * i_mean);
  }
  r.t.pop_back();
  r.theta_m.pop_back();
  r.i_alphabeta.pop_back();
  r.v_dc.assign(rows, 235.4);
  r.T_load.assign(rows, 0.7);
  r.electrical_ok.assign(rows, 1);
  r.motion_ok.assign(rows, 1);
  return r;
}

// The readings have a line near the rate of the thinned rows, as counts at constant speed make it.
TEST(Thinning, FoldsNoLineOfTheReadingsIntoTheVoltage) {
  constexpr double kError = 1e-3;  // rad
  constexpr std::size_t kRows = 4;
  const int n_p = servo().machine.n_p;
  const Vec2 u_dq(-20, 60);
  Record r;
  r.T_s = 5e-5;
  for (std::size_t k = 0; k < 4000; ++k) {
    const double t = static_cast<double>(k) * r.T_s, theta_m = 40 * t;
    r.t.push_back(t);
    r.theta_m.push_back(theta_m + kError * std::sin(kTwoPi * 1.03 / (kRows * r.T_s) * t));
    r.u_alphabeta.push_back(inverse_park(u_dq, n_p * theta_m));
  }
  r.electrical_ok.assign(r.t.size(), 1);
  r.motion_ok = r.electrical_ok;
  const Record thin = thinned(r, kRows, n_p);
  double mean = 0, squares = 0;
  for (std::size_t k = 0; k < thin.size(); ++k) {
    const double u_d = park(thin.u_alphabeta[k], n_p * thin.theta_m[k])[0];
    mean += u_d / static_cast<double>(thin.size());
    squares += u_d * u_d / static_cast<double>(thin.size());
  }
  const double one_reading = n_p * kError * u_dq.norm();  // V, of an error that nothing averages
  EXPECT_LT(std::sqrt(squares - mean * mean), 0.02 * one_reading);
}

// A voltage that acts late is, row by row of the log, a step that comes late. In a row for four it is
// that of the thinned log of what acted.
TEST(Thinning, KeepsALateVoltage) {
  const DriveFacts facts = servo().facts();
  const Record whole = fast_record(5e-5, 8000);
  for (const double ticks : {0.84, 2.3}) {
    Record acted = whole;
    const auto past = static_cast<std::size_t>(ticks);
    const double part = ticks - static_cast<double>(past);
    for (std::size_t k = past + 1; k < whole.size(); ++k)
      acted.u_alphabeta[k] =
          (1 - part) * whole.u_alphabeta[k - past] + part * whole.u_alphabeta[k - past - 1];
    const Record thin = thinned(whole, 4, facts.machine.n_p),
                 thin_acted = thinned(acted, 4, facts.machine.n_p);
    const Equations equations(thin, facts);
    const auto lag = make_effect("signal_lag");
    set_key(*lag, "signal", SamplingFacts::kVoltage);
    set_key(*lag, "lag_s", ticks * whole.T_s);
    ASSERT_EQ(lag->prepare(facts), "");
    const Effects alone{lag};
    const RecordContributions added(alone, equations.points(), thin);
    double wrong = 0, size = 0;
    for (std::size_t k = 20; k + 20 < thin.size(); ++k) {
      const Vec2 drop = thin.u_alphabeta[k] - thin_acted.u_alphabeta[k];
      wrong += (equations.points()[k].stator_axes(added.of_interval(k)) - drop).squaredNorm();
      size += drop.squaredNorm();
    }
    EXPECT_LT(std::sqrt(wrong / size), 5e-3) << ticks;  // 0.17, 0.09 by steps at the rows' ends
  }
}

TEST(Thinning, KeepsTheVoltageEquation) {
  const Record whole = fast_record(5e-5, 8000);
  for (const std::size_t rows : {1u, 2u, 4u}) {
    const Record thin = thinned(whole, rows, servo().machine.n_p);
    EXPECT_DOUBLE_EQ(thin.T_s, static_cast<double>(rows) * whole.T_s);
    const Equations equations(thin, servo().facts());
    const Channels left = equations.residual({});
    double most = 0;
    for (std::size_t k = 20; k + 20 < thin.size(); ++k)
      most = std::max({most, std::abs(left.d[k]), std::abs(left.q[k])});
    // Without the rotation at least 1.3 V of the 507 V of the magnets would remain; with R_s i as
    // the mean of both ends, without its curvature, 17 mV; without the cubic at least 10 mV.
    EXPECT_LT(most, 0.001 * static_cast<double>(rows)) << rows;
    EXPECT_NEAR(thin.T_load[100], 0.7, 1e-12);
    EXPECT_NEAR(thin.v_dc[100], 235.4, 1e-9);
  }
}

// The weights -1, 0, 9, 16, 9, 0, -1 of 32.
TEST(Thinning, UsesTheWeightsOfTheFilter) {
  const Record whole = fast_record(1e-4, 1000);
  const Record thin = thinned(whole, 2, servo().machine.n_p);
  const std::size_t K = 100, k = 2 * K + 3;
  EXPECT_EQ(thin.t[K], whole.t[k]);
  EXPECT_NEAR(thin.theta_m[K],
              (16 * whole.theta_m[k] + 9 * (whole.theta_m[k - 1] + whole.theta_m[k + 1]) -
               whole.theta_m[k - 3] - whole.theta_m[k + 3]) /
                  32,
              1e-12);
  EXPECT_EQ(thin.rows_each, 2);
  EXPECT_EQ(thinned(whole, 1, 3).size(), whole.size());
}

TEST(Thinning, KeepsACubic) {
  Record whole = fast_record(1e-4, 1000);
  for (std::size_t rows : {2u, 3u, 4u}) {
    for (std::size_t k = 0; k < whole.size(); ++k) whole.T_load[k] = std::pow(whole.t[k] - 0.04, 3);
    const Record thin = thinned(whole, rows, 3);
    for (std::size_t K = 0; K < thin.size(); ++K)
      ASSERT_NEAR(thin.T_load[K], std::pow(thin.t[K] - 0.04, 3), 1e-12) << rows << " " << K;
  }
}

TEST(Thinning, AnUnusableRowExcludesTheRowsThatContainIt) {
  Record whole = fast_record(1e-4, 1000);
  whole.motion_ok[200] = 0;      // in rows 97 to 100, which use 197 to 203
  whole.electrical_ok[601] = 0;  // in rows that use 597 to 603, and in their voltages
  const Record thin = thinned(whole, 2, servo().machine.n_p);
  for (std::size_t K = 0; K < thin.size(); ++K) {
    EXPECT_EQ(thin.motion_ok[K] != 0, K < 97 || K > 100) << K;
    EXPECT_EQ(thin.electrical_ok[K] != 0, K < 297 || K > 300) << K;
  }
  std::vector<char> held(1000, 0);
  held[603] = 1;
  EXPECT_EQ(thinned(held, whole, 2)[300], 1);
  EXPECT_EQ(thinned(held, whole, 2).size(), thin.size());
}

TEST(Thinning, DoesNotMixRowsAcrossAGap) {
  Record both = fast_record(1e-4, 1000);
  Record second = fast_record(1e-4, 1000);
  for (double& theta_m : second.theta_m) theta_m += 1e3;
  both.append(second);
  const Record thin = thinned(both, 2, 3);
  for (std::size_t K = 0; K < thin.size(); ++K)
    EXPECT_TRUE(thin.theta_m[K] < 100 || thin.theta_m[K] > 999) << K;
  EXPECT_EQ(thinned(both.motion_ok, both, 2).size(), thin.size());
}

TEST(Thinning, IsNotSlowerThan5kHz) {
  EXPECT_EQ(rows_as_one(1e-4), 2u);
  EXPECT_EQ(rows_as_one(1.0 / 8000), 1u);
  EXPECT_EQ(rows_as_one(2e-4), 1u);
  EXPECT_EQ(rows_as_one(5e-5), 4u);
  EXPECT_EQ(rows_as_one(1.0 / 15000), 3u);
}

}  // namespace twinrate::thinning_test
