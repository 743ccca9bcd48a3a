#include "controller/lqr_design.hpp"

#include <gtest/gtest.h>

#include "controller/scaled_tuning.hpp"
#include "model/frames.hpp"
#include "tests/support/drives.hpp"

namespace twinrate {
namespace {

LqrDesign design(const LqrDesignParameters& p, double J = 8.8e-3) {
  const DriveConfig drive = test::drive_of("niewiara2020");
  MachineParameters machine = drive.machine;
  machine.J = J;
  return design_lqr(machine, drive.inverter.v_dc, drive.T_s(), p);
}

TEST(LqrDesign, WeightsOfTheDAxisGiveThePrintedGains) {
  const LqrDesign d = design({.gains = GainSource::kNumbers});
  EXPECT_NEAR(d.d.K[0], 0.22, 5e-5);  // (40), four digits
  EXPECT_NEAR(d.d.K[1], 8.14, 5e-3);
  EXPECT_LT(d.d.residual, 1e-10);
  EXPECT_LT(d.q.residual, 1e-10);
}

TEST(LqrDesign, TheInertiaOfTheMotorAloneGivesThePrintedGainsOfTheQAxis) {
  const LqrDesign d = design({.gains = GainSource::kNumbers}, 5.5e-3);
  EXPECT_NEAR(d.q.K[0], 0.08, 5e-4);
  EXPECT_NEAR(d.q.K[1], 0.06, 5e-4);
  EXPECT_NEAR(d.q.K[2], 4.05, 5e-3);
}

TEST(LqrDesign, AtTheTrueInertiaNoWeightsGiveThePrintedGains) {
  const LqrDesign d = design({});
  const NearestWeights q = nearest_weights(d.q, 1e-4);
  EXPECT_NEAR(q.K[0], 0.0737, 2e-4);  // docs: nearest [0.0737, 0.0686, 3.687]
  EXPECT_NEAR(q.K[1], 0.0686, 2e-4);
  EXPECT_NEAR(q.K[2], 3.687, 0.01);
  EXPECT_GT(q.largest_error, 0.1);
  EXPECT_LT(nearest_weights(d.d, 1e-4).largest_error, 1e-4);  // the d axis has them
}

TEST(LqrDesign, FeedForwardAsksForMoreVoltageUnderLoad) {
  const LqrDesign d = design({});
  EXPECT_NEAR(d.K_ff, -0.078, 5e-5);  // (41) with (38)'s sign
  EXPECT_NEAR(d.K_pp, 117.7, 1e-9);
}

// The steady state under a load without the integral: i_q = T_o/K_t at unchanged speed.
TEST(LqrDesign, FeedForwardHoldsTheSpeedUnderLoadByItself) {
  const LqrDesign d = design({});
  const MachineParameters m = test::drive_of("niewiara2020").machine;
  const double T_o = 2.5, i_q = T_o / m.torque_constant();
  const double u = -d.q.K[0] * i_q - d.K_ff * T_o;  // omega_m and p_omega as before
  EXPECT_NEAR(d.K_pp * u, m.R_s * i_q, 1e-9);
}

TEST(LqrDesign, PolesAreTheGivenBandwidths) {
  LqrDesignParameters p{.gains = GainSource::kBandwidths};
  p.bandwidth_q_Hz[0] = 150, p.bandwidth_q_Hz[1] = 12, p.bandwidth_q_Hz[2] = 4;
  const LqrDesign d = design(p);
  ASSERT_TRUE(d.q.complaints.empty());
  std::vector<double> f_Hz;
  for (const auto& z : d.q.poles) f_Hz.push_back(-std::log(z).real() / 1e-4 / kTwoPi);
  std::sort(f_Hz.begin(), f_Hz.end());
  EXPECT_NEAR(f_Hz[0], 4, 0.05);
  EXPECT_NEAR(f_Hz[1], 12, 0.1);
  EXPECT_NEAR(f_Hz[2], 150, 2);
}

TEST(LqrDesign, ReportsBandwidthsBelowTheOpenLoop) {
  LqrDesignParameters p{.gains = GainSource::kBandwidths};
  for (double& f : p.bandwidth_q_Hz) f = 2;  // R_s/L_q alone is 13 Hz
  const LqrDesign d = design(p);
  ASSERT_FALSE(d.q.complaints.empty());
  EXPECT_NE(d.q.complaints[0].find("i_q"), std::string::npos);
}

// Currents that decay by themselves within a few ticks.
TEST(LqrDesign, TheDefaultsSuitAMotorOfSmallInductance) {
  for (const double decay_Hz : {20.0, 500.0, 1400.0, 4000.0}) {
    DriveConfig drive = test::drive_of("niewiara2020");  // 10 kHz
    drive.machine.L_d = drive.machine.R_s / (kTwoPi * decay_Hz);
    drive.machine.L_q = 1.5 * drive.machine.L_d;
    LqrParameters p;
    scale(p, drive);
    const LqrDesign d = design_lqr(drive.machine, drive.inverter.v_dc, drive.T_s(), p.design);
    EXPECT_TRUE(d.d.complaints.empty()) << decay_Hz << " " << d.d.complaints.front();
    EXPECT_TRUE(d.q.complaints.empty()) << decay_Hz << " " << d.q.complaints.front();
    EXPECT_GT(margins_of(d.q, drive.plant.delay_samples, drive.T_s()).phase_rad, kPi / 4)
        << decay_Hz;
  }
}

TEST(LqrDesign, ReportsAWeightOfZeroOnTheIntegral) {
  LqrDesignParameters p{.gains = GainSource::kNumbers};
  p.Q_q[2] = 0;
  EXPECT_FALSE(design(p).q.complaints.empty());
  EXPECT_TRUE(design(p).d.complaints.empty());
}

TEST(LqrDesign, DeviationsAreTheirInverseSquaresAsWeights) {
  LqrDesignParameters deviations{.gains = GainSource::kDeviations};
  LqrDesignParameters weights{.gains = GainSource::kNumbers};
  for (int i = 0; i < 3; ++i)
    weights.Q_q[i] = 1 / (deviations.deviation_q[i] * deviations.deviation_q[i]);
  weights.R_q = 1 / (deviations.deviation_q[3] * deviations.deviation_q[3]);
  EXPECT_LT((design(deviations).q.K - design(weights).q.K).norm(), 1e-12);
}

TEST(LqrDesign, ReportsGivenGainsThatDoNotStabilise) {
  LqrDesignParameters p;
  p.K_q[2] = -4.05;
  EXPECT_FALSE(design(p).q.complaints.empty());
  EXPECT_THROW(
      {
        Config config = test::load("niewiara2020", {"controller.lqr.K_q=[0.08, 0.06, -4.05]"});
        make_controller(config);
      },
      BadInput);
}

}  // namespace
}  // namespace twinrate
