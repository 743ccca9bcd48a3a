#include "estimator/registry.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "estimator/covariance.hpp"
#include "estimator/propagated_gain.hpp"
#include "model/discretise.hpp"
#include "tests/support/drives.hpp"

namespace twinrate {
namespace {

// The kinds of the contract.
const std::vector<std::string> kContractKinds{
    "ekf_sensorless", "ekf_disturbance", "backemf_printed", "active_flux",
    "eemf",           "dq_ekf",          "ekf_harmonic",    "ekf_joint"};

TEST(FilterRegistry, EveryKindIsOneOfTheContract) {
  ASSERT_GE(filter_kinds().size(), 2u);
  for (const std::string& kind : filter_kinds())
    EXPECT_NE(std::find(kContractKinds.begin(), kContractKinds.end(), kind), kContractKinds.end())
        << kind;
}

TEST(FilterRegistry, EveryKindBuildsFromEveryPresetUnderItsOwnName) {
  for (const std::string& preset : preset_names()) {
    for (const std::string& kind : filter_kinds()) {
      Config config = test::load(preset, {"estimator.kind=" + kind});
      const auto filter = make_filter(config);
      ASSERT_NE(filter, nullptr);
      EXPECT_EQ(filter->kind(), kind);
      EXPECT_TRUE(filter->initial_gain().P.allFinite());
    }
  }
}

TEST(FilterRegistry, AnUnknownKindHasNoBuilder) {
  EXPECT_EQ(filter_builder("luenberger"), nullptr);
}

TEST(FilterRegistry, EveryPredictionAndCovarianceOfTheContractIsAccepted) {
  for (const char* prediction : {"euler", "rk4", "exact"})
    EXPECT_NO_THROW(test::load("dilys2021", {fmt::format("estimator.prediction={}", prediction)}));
  for (const char* covariance : {"joseph", "paper", "sequential", "auto"})
    EXPECT_NO_THROW(test::load("dilys2021", {fmt::format("estimator.covariance={}", covariance)}));
}

TEST(FilterRegistry, TheChoicesOfTheConfigMeanTheEnumeratorsOfTheCode) {
  const auto index = [](const char* override_text) {
    return test::drive_of("dilys2021", {override_text}).estimator;
  };
  EXPECT_EQ(index("estimator.prediction=euler").prediction, Prediction::kEuler);
  EXPECT_EQ(index("estimator.prediction=rk4").prediction, Prediction::kRk4);
  EXPECT_EQ(index("estimator.prediction=exact").prediction, Prediction::kExact);
  EXPECT_EQ(index("estimator.covariance=joseph").covariance, CovarianceForm::kJoseph);
  EXPECT_EQ(index("estimator.covariance=paper").covariance, CovarianceForm::kPaper);
  EXPECT_EQ(index("estimator.covariance=sequential").covariance, CovarianceForm::kSequential);
  EXPECT_EQ(index("estimator.covariance=auto").covariance, CovarianceForm::kAuto);
}

TEST(CovarianceForm, AutoTakesTheSequentialFormWhereRIsSmall) {
  EXPECT_EQ(resolve(CovarianceForm::kAuto, 1e-4, 1e2), CovarianceForm::kJoseph);
  EXPECT_EQ(resolve(CovarianceForm::kAuto, 9e-5, 1e2), CovarianceForm::kSequential);
  EXPECT_EQ(resolve(CovarianceForm::kPaper, 1e-12, 1e2), CovarianceForm::kPaper);
}

TEST(FilterRegistry, ATuningKeyOfTheFileReachesTheFilter) {
  Config config = test::load("dilys2021", {"estimator.ekf_sensorless.P0_diag=[1, 2, 3, 4]"});
  EXPECT_EQ(make_filter(config)->initial_gain().P(3, 3), 4);
}

TEST(FilterRegistry, AnUnknownTuningKeyIsBadInput) {
  Config config = test::load("dilys2021", {"estimator.ekf_sensorless.Q_dig=1"});
  EXPECT_THROW(make_filter(config), BadInput);
}

// The load of its oscillators turns on with the rotor: its rate is the slope of that.
TEST(EkfHarmonic, TheRateOfTheLoadIsItsSlopeAlongTheTurn) {
  Config config = test::load("niewiara2020", {"estimator.kind=ekf_harmonic"});
  const auto filter = make_filter(config);
  const double T_s = config.drive().T_s();
  Measurement m{.k = 0, .signals = kPhaseCurrents | kVoltage | kPosition | kSpeed};
  m.theta_m = 0.4;
  m.omega_m = 5;
  FastState state = filter->start(m);
  const int n_x = filter->initial_gain().n_x;
  ASSERT_GT(n_x, 4);
  for (int i = 4; i < n_x; ++i) state.x_hat[i] = 0.3 * std::sin(1.7 * i);
  const Estimate now = filter->output(state, m);
  filter->predict_over_gap(state, m);
  m.theta_m = state.theta_m_prev;
  const Estimate then = filter->output(state, m);
  const double slope = (then.T_load - now.T_load) / T_s;
  EXPECT_GT(std::abs(slope), 1);
  EXPECT_NEAR(0.5 * (now.dT_load_dt + then.dT_load_dt), slope, 0.02 * std::abs(slope));
}

// A tick without a measurement is predicted: the state turns on, and is not held.
TEST(EkfHarmonic, ATickWithoutMeasurementIsPredicted) {
  Config config = test::load("niewiara2020", {"estimator.kind=ekf_harmonic"});
  const auto filter = make_filter(config);
  Measurement m{.k = 0, .signals = kPhaseCurrents | kVoltage | kPosition | kSpeed};
  m.theta_m = 0.4;
  m.omega_m = 5;
  FastState stepped = filter->start(m);
  FastState predicted = stepped;
  Measurement lost{.k = 1};
  filter->fast_step(stepped, lost, Gain{});
  filter->predict_over_gap(predicted, lost);
  EXPECT_NEAR(stepped.theta_m_prev, 0.4 + 5 * config.drive().T_s(), 1e-9);
  EXPECT_EQ(stepped.x_hat, predicted.x_hat);
}

// A load b sin(6 theta_m) opposes the speed, with its value in mid-interval; by hand.
TEST(EkfJoint, ThePairOfAnOrderBrakesWithItsValueInMidInterval) {
  Config config = test::load(
      "dilys2021",
      {"estimator.kind=ekf_joint", "estimator.ekf_joint.order=6", "estimator.prediction=euler"});
  const auto filter = make_filter(config);
  const MachineParameters& machine = config.drive().machine;
  const double T_s = config.drive().T_s(), omega_e = 300, b = 0.01;
  FastState state;
  state.x_hat.head<7>() << 0, 0, omega_e, 0, 0, 0, b;
  filter->predict_over_gap(state, Measurement{});
  const double T_mid = b * std::sin(0.5 * 6 * omega_e / machine.n_p * T_s);
  EXPECT_NEAR(omega_e - state.x_hat[2], T_s * machine.n_p / machine.J * T_mid, 1e-9);
}

// Between two snapshots the covariance turns with their mean speed.
TEST(PropagatedGain, HasTheMeanSpeedOfItsTwoSnapshots) {
  Config config = test::load("dilys2021");
  const auto filter = make_filter(config);
  Gain previous = filter->initial_gain();
  previous.k = 0;
  const auto P = [&](double omega_m_before, double omega_m) {
    Estimate snapshot{.k = 10};
    snapshot.omega_m = omega_m;
    return propagated_background(*filter, previous, omega_m_before, snapshot, 50, 150).P;
  };
  EXPECT_EQ(P(60, 100), P(80, 80));
  EXPECT_NE(P(60, 100), P(100, 100));
}

}  // namespace
}  // namespace twinrate
