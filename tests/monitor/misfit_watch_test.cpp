#include "monitor/misfit_watch.hpp"

#include <gtest/gtest.h>

#include "core/config.hpp"
#include "model/random.hpp"

namespace twinrate {
namespace {

// A machine at constant speed with currents of pure noise, the voltage of zero current, and an
// additional voltage `u_off`.
std::deque<MeasuredRow> rows_of(const DriveConfig& drive, double u_off, std::uint64_t seed,
                                double i_noise_A = 0.008) {
  std::deque<MeasuredRow> rows;
  const double omega_m = 20;
  for (std::int64_t k = 0; k < 2500; ++k) {
    const auto n = static_cast<std::uint64_t>(k);
    Measurement m;
    m.k = k;
    m.t_ns = drive.t_ns(k);
    m.signals = kPhaseCurrents | kPosition | kVoltage | kBusVoltage;
    m.theta_m = omega_m * 1e-9 * static_cast<double>(m.t_ns);
    m.i_abc = i_noise_A * Vec3(normal(seed, 1, n), normal(seed, 2, n), normal(seed, 3, n));
    m.v_dc = 235.4;
    // Applied from t_{k-1} to t_k: the EMF in mid-interval.
    const double theta_mid = drive.machine.n_p * (m.theta_m - 0.5 * omega_m * drive.T_s());
    const double x = 0.5 * drive.machine.n_p * omega_m * drive.T_s();
    const double emf = drive.machine.n_p * omega_m * drive.machine.psi_f * std::sin(x) / x;
    m.u_alphabeta = inverse_park({0, emf + u_off}, theta_mid);
    rows.push_back({m, 0});
  }
  return rows;
}

class Misfit : public testing::Test {
 protected:
  void SetUp() override {
    for (std::uint64_t seed = 1; seed <= 8; ++seed) {
      const auto rows = rows_of(drive_, 0, seed);
      watch_.learn(rows, 0, rows.size(), {}, {});
    }
    ASSERT_TRUE(watch_.learnt());
  }
  BlockVerdict verdict_of(double u_off, std::uint64_t seed,
                          const Effects& model_effects = {}) const {
    const auto rows = rows_of(drive_, u_off, seed);
    return watch_.test(rows, 0, rows.size(), {}, model_effects);
  }
  DriveConfig drive_ = Config::load("niewiara2020").drive();
  MisfitWatch watch_{drive_};
};

TEST_F(Misfit, BlocksLikeTheLearntOnesFit) {
  for (std::uint64_t seed = 100; seed < 140; ++seed) EXPECT_TRUE(verdict_of(0, seed).fits) << seed;
}

TEST_F(Misfit, AVoltageMissingInTheModelIsAMisfit) {
  const BlockVerdict verdict = verdict_of(0.5, 200);
  EXPECT_FALSE(verdict.fits);
  ASSERT_TRUE(verdict.worst());
  EXPECT_EQ(verdict.worst()->name, "voltage residual q");
  EXPECT_GT(verdict.worst()->rms, 0.45);
  EXPECT_LT(verdict.worst()->rms, 0.65);
  EXPECT_LT(verdict.worst()->consistency, 1e-9);
}

TEST_F(Misfit, TheExtendedModelFits) {
  const Config extended = Config::load("niewiara2020", {"effect=[]"})
                              .with_effects(
                                  "[[effect]]\nkind = \"flux_linkage\"\nused_in = "
                                  "\"model\"\nchange_Wb = 0.008333333333333333\n",
                                  "test");  // 0.5 V at 60 rad/s
  EXPECT_FALSE(verdict_of(0.5, 201).fits);
  EXPECT_TRUE(verdict_of(0.5, 201, extended.drive().model_effects()).fits)
      << verdict_of(0.5, 201, extended.drive().model_effects()).text();
}

// The residuals are linear in the currents: a block of half the noise has a quarter of the power.
TEST_F(Misfit, TheLevelIsThatOfTheNoisiestLearntBlock) {
  MisfitWatch watch(drive_);
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const auto rows = rows_of(drive_, 0, seed, seed == 5 ? 0.016 : 0.008);
    watch.learn(rows, 0, rows.size(), {}, {});
  }
  ASSERT_TRUE(watch.learnt());
  const auto verdict_at = [&](double i_noise_A, std::uint64_t seed) {
    const auto rows = rows_of(drive_, 0, seed, i_noise_A);
    return watch.test(rows, 0, rows.size(), {}, {});
  };
  for (std::uint64_t seed = 300; seed < 310; ++seed) {
    const BlockVerdict loud = verdict_at(0.016, seed), quiet = verdict_at(0.008, seed);
    EXPECT_TRUE(loud.fits) << loud.text();
    EXPECT_TRUE(quiet.fits) << quiet.text();
    ASSERT_TRUE(loud.worst() && quiet.worst());
    EXPECT_GT(loud.worst()->excess, 0.6) << loud.text();
    EXPECT_LT(loud.worst()->excess, 1.6) << loud.text();
    EXPECT_GT(quiet.worst()->excess, 0.15) << quiet.text();
    EXPECT_LT(quiet.worst()->excess, 0.4) << quiet.text();
  }
}

// A block of twice the noise (4 times the power) raises the level, one of ten times the noise does not:
// a misfit must not become the level.
TEST_F(Misfit, AnAcceptedBlockRaisesTheLevelUpToNineTimes) {
  const auto accept = [&](double i_noise_A) {
    MisfitWatch watch = watch_;
    const auto rows = rows_of(drive_, 0, 400, i_noise_A);
    watch.accept(rows, 0, rows.size(), {}, {});
    const auto loud = rows_of(drive_, 0, 401, 0.016);
    return watch.test(loud, 0, loud.size(), {}, {});
  };
  EXPECT_FALSE(accept(0.008).fits);
  EXPECT_TRUE(accept(0.016).fits);
  EXPECT_FALSE(accept(0.08).fits);
}

// So many rows prove a change that is far below what the level itself moves by.
TEST_F(Misfit, AChangeThatIsCertainButSmallStillFits) {
  int certain_and_small = 0;
  for (double u_off = 0.003; u_off < 0.006; u_off += 0.0005) {
    const BlockVerdict verdict = verdict_of(u_off, 202);
    ASSERT_TRUE(verdict.worst());
    const ChannelLevel& worst = *verdict.worst();
    if (worst.consistency >= 1e-9 || worst.excess >= MisfitWatch::kMargin) continue;
    EXPECT_TRUE(verdict.fits) << u_off << " V: " << verdict.text();
    ++certain_and_small;
  }
  EXPECT_GT(certain_and_small, 0);
}

}  // namespace
}  // namespace twinrate
