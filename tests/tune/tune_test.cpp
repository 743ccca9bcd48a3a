// Noise weights from a log: a log made by the filter's own model with known Q and R is the oracle.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "estimator/ekf_sensorless.hpp"
#include "loop/load_drive.hpp"
#include "tune/consistency.hpp"
#include "tune/knobs.hpp"

namespace twinrate::tune {
namespace {

constexpr double kQ[4] = {1e-4, 1e-4, 0.04, 1e-8}, kR = 4e-4, kOmega_e = 400;

const std::vector<std::string> kRun = {"start=flying", "reference.omega_e_rad_s=400",
                                       "run.settle_s=0.1", "estimator.prediction=euler"};

std::vector<std::string> with_weights(double of_Q, double of_R) {
  auto list = kRun;
  list.push_back("estimator.ekf_sensorless.Q_diag=[" + std::to_string(of_Q * kQ[0]) + "," +
                 std::to_string(of_Q * kQ[1]) + "," + std::to_string(of_Q * kQ[2]) + ",1e-8]");
  list.push_back("estimator.ekf_sensorless.R_diag=[" + std::to_string(of_R * kR) + "," +
                 std::to_string(of_R * kR) + "]");
  return list;
}

// x(k+1) = x + T_s f(x, u) + w, y = H x + v, with the Q and R above; the voltage holds 2 A at the mean speed.
RunLog log_of_the_model(int ticks) {
  const Config config = load_drive("dilys2021", kRun);
  const DriveConfig& d = config.drive();
  const EkfSensorless model(d.machine, {}, Prediction::kEuler, CovarianceForm::kJoseph, d.T_s());
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  RunLog log;
  log.path = "model";
  EkfSensorless::State x(0, 0, kOmega_e, 0);
  for (int k = 0; k < ticks; ++k) {
    Measurement m;
    m.k = k;
    m.t_ns = std::llround(1e9 * k * d.T_s());
    m.signals = kPhaseCurrents | kVoltage;
    const Vec2 u_dq(-d.machine.L_q * kOmega_e * 2, d.machine.R_s * 2 + d.machine.psi_f * kOmega_e);
    if (k > 0) {
      m.u_alphabeta = rotate(u_dq, x[3] + 0.5 * x[2] * d.T_s());
      x = model.predict(x, m.u_alphabeta);
      for (int i = 0; i < 4; ++i) x[i] += std::sqrt(kQ[i]) * normal(random);
      x[2] += 1e-3 * (kOmega_e - x[2]);  // the walk stays near the mean speed
    }
    const Vec2 y(x[0] + std::sqrt(kR) * normal(random), x[1] + std::sqrt(kR) * normal(random));
    m.i_abc = inverse_clarke(y);
    log.measurement.push_back(m);
  }
  return log;
}

const RunLog& model_log() {
  static const RunLog log = log_of_the_model(10000);
  return log;
}

double likelihood(double of_Q, double of_R) {
  return consistency_of("dilys2021", with_weights(of_Q, of_R), model_log(), 0, 1, Angle::kLeftOut)
      .log_likelihood;
}

// 9500 ticks of two outputs: the mean of NIS/2 has a standard deviation of 1/sqrt(9500) = 1.0 %.
TEST(Consistency, TheTrueWeightsAreConsistent) {
  const Consistency c =
      consistency_of("dilys2021", with_weights(1, 1), model_log(), 0, 1, Angle::kLeftOut);
  EXPECT_GT(c.ticks, 9000);
  EXPECT_NEAR(c.nis, 1, 0.05);
  EXPECT_NEAR(c.inside, 0.95, 0.01);
  EXPECT_NEAR(c.autocorrelation, 0, 0.04);
}

TEST(Consistency, AFactorOnBothWeightsIsThatOfTheNis) {
  const Consistency c =
      consistency_of("dilys2021", with_weights(10, 10), model_log(), 0, 1, Angle::kLeftOut);
  EXPECT_NEAR(10 * c.nis, 1, 0.1);
  EXPECT_GT(c.inside, 0.99);
  EXPECT_LT(c.log_likelihood, c.best_log_likelihood);
}

TEST(Consistency, TheTrueWeightsAreTheMostLikely) {
  const double best = likelihood(1, 1);
  EXPECT_GT(best, likelihood(4, 1));
  EXPECT_GT(best, likelihood(0.25, 1));
  EXPECT_GT(best, likelihood(1, 2));
  EXPECT_GT(best, likelihood(1, 0.5));
}

// Weights of the drive file that are right cannot be beaten: a change of 1 % is chance. Four times R
// is not. Sixteen ticks tell nothing.
TEST(Consistency, MoreLikelyMeansByMoreThanChance) {
  const auto judged = [](double of_R, double from) {
    return consistency_of("dilys2021", with_weights(1, of_R), model_log(), from, 1,
                          Angle::kLeftOut);
  };
  const Consistency right = judged(1, 0), wrong = judged(4, 0);
  const Gained gain = gained(wrong, right), loss = gained(right, judged(1.01, 0));
  EXPECT_GT(gain.mean, 2 * gain.sigma);
  EXPECT_LT(loss.mean, 2 * loss.sigma);
  EXPECT_NEAR(gain.mean, right.log_likelihood - wrong.best_log_likelihood, 1e-9);
  EXPECT_TRUE(std::isinf(gained(judged(4, 0.9984), judged(1, 0.9984)).sigma));
}

// Every third tick is missing: no judged tick follows another one, so no pair is one tick apart. The
// weights are wrong, so that the innovations before and after a missing tick are correlated.
TEST(Consistency, TheAutocorrelationHasNoPairAcrossAMissingTick) {
  RunLog log = model_log();
  log.measurement.resize(3000);
  const auto autocorrelation = [&] {
    return consistency_of("dilys2021", with_weights(0.01, 1), log, 0, 1, Angle::kLeftOut)
        .autocorrelation;
  };
  EXPECT_GT(std::abs(autocorrelation()), 0.05);
  std::erase_if(log.measurement, [](const Measurement& m) { return m.k % 3 == 2; });
  EXPECT_EQ(autocorrelation(), 0);
}

TEST(Consistency, RefusesALogOfAnotherRate) {
  auto list = with_weights(1, 1);
  list.emplace_back("rates.f_s_Hz=10000");
  try {
    consistency_of("dilys2021", list, model_log());
    FAIL();
  } catch (const BadInput& e) {
    EXPECT_STREQ(e.what(), "model: recorded at 5000 Hz, but dilys2021 has rates.f_s_Hz = 10000");
  }
}

TEST(Consistency, RefusesALogWithoutCurrent) {
  RunLog log = model_log();
  for (Measurement& m : log.measurement) m.i_abc.setZero(), m.u_alphabeta.setZero();
  try {
    FAIL() << consistency_of("dilys2021", with_weights(1, 1), log).nis;
  } catch (const BadInput& e) {
    EXPECT_STREQ(e.what(), "model: every innovation is zero: the log has no current to tune with");
  }
}

TEST(Knobs, EqualWeightsAreOneAndZerosAreNone) {
  Config config = load_drive("dilys2021", {"estimator.ekf_sensorless.Q_diag=[2, 2, 500, 0]"});
  Knobs knobs = knobs_of(config);
  ASSERT_EQ(knobs.list.size(), 4U);  // two of Q, one of R, one of P0
  EXPECT_EQ(knobs.list[0].index, (std::vector<int>{0, 1}));
  EXPECT_EQ(knobs.list[1].value, 500);
  knobs.set(0, 3);
  EXPECT_EQ(knobs.overrides().front(), "estimator.ekf_sensorless.Q_diag=[3, 3, 500, 0]");
  knobs.scale_weights(2);
  EXPECT_EQ(knobs.table(),
            "[estimator.ekf_sensorless]\nQ_diag = [6, 6, 1000, 0]\nR_diag = [2, 2]\n"
            "P0_diag = [2, 2, 2, 2]\n");
}

TEST(Knobs, TheIntegralGainIsNotScaledWithTheWeights) {
  Config config = load_drive("niewiara2020");
  Knobs knobs = knobs_of(config);
  const auto gain = std::find_if(knobs.list.begin(), knobs.list.end(),
                                 [](const Knob& knob) { return !knob.is_weight; });
  ASSERT_NE(gain, knobs.list.end());
  EXPECT_EQ(gain->key, "estimator." + config.drive().estimator.kind + ".L_Nm_rad");
  const double before = gain->value;
  knobs.scale_weights(5);
  EXPECT_EQ(gain->value, before);
  load_drive("niewiara2020",
             knobs.overrides());  // every override is a key that the drive file may have
}

}  // namespace
}  // namespace twinrate::tune
