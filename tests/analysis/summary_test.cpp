#include "analysis/summary.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "core/channels.hpp"
#include "core/reason.hpp"
#include "tests/analysis/steady_run.hpp"

namespace twinrate {
namespace {

// theta_e_hat - theta_e of the ticks in [first, last).
void put_angle_error(RunLog& log, std::size_t first, std::size_t last, double error_rad) {
  for (std::size_t k = first; k < last; ++k)
    log.estimate[k].theta_e = wrap_turn(4 * log.truth[k].theta_m + error_rad);
}

TEST(Summary, FiguresUseOnlyTheWindow) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  put_angle_error(log, 0, 500, 1.0);
  put_angle_error(log, 500, 1250, 0.1);
  put_angle_error(log, 1250, 2000, -0.3);
  for (std::size_t k = 500; k < 2000; ++k) log.estimate[k].omega_m += 2;
  const Summary s = summarise(log, config);
  EXPECT_NEAR(*s.angle_error_rms, std::sqrt((0.01 + 0.09) / 2), 1e-9);
  EXPECT_NEAR(*s.angle_error_max, 0.3, 1e-9);
  EXPECT_NEAR(*s.speed_error_rms, 2, 1e-9);
  EXPECT_EQ(s.locked, true);
  EXPECT_EQ(s.steps, 2000);
  EXPECT_NEAR(s.duration_s, 2, 1e-12);
  EXPECT_EQ(s.angle_reference, AngleReference::kTruth);
}

TEST(Summary, ErrorsAreEstimateLessTruthAndWrapIntoHalfATurn) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  put_angle_error(log, 0, 2000, 0.2);
  for (Estimate& e : log.estimate) e.omega_m += 3;
  for (const TickError& error : tick_errors(log, config)) {
    EXPECT_NEAR(error.angle_error, 0.2, 1e-9);
    EXPECT_NEAR(error.speed_error, 3, 1e-9);
    EXPECT_EQ(error.omega_m, kOmegaM);
  }
  put_angle_error(log, 0, 2000, kTwoPi - 0.2);
  for (const TickError& error : tick_errors(log, config))
    EXPECT_NEAR(error.angle_error, -0.2, 1e-9);
}

TEST(Summary, IsLostByOneAngleErrorBeyondAQuarterTurnInTheWindow) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  put_angle_error(log, 1000, 1001, 1.56);
  EXPECT_EQ(summarise(log, config).locked, true);
  put_angle_error(log, 1000, 1001, -1.58);
  const Summary s = summarise(log, config);
  EXPECT_EQ(s.locked, false);
  EXPECT_NEAR(*s.lost_at_s, 1.0, 1e-9);
  EXPECT_NE(s.lost_why.find("angle"), std::string::npos);
}

TEST(Summary, StartUpDoesNotDecideTheVerdictButTheTimeOfTheLoss) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  put_angle_error(log, 200, 210, 2.0);
  EXPECT_EQ(summarise(log, config).locked, true);
  EXPECT_FALSE(summarise(log, config).lost_at_s.has_value());
  put_angle_error(log, 1500, 1600, 2.0);
  EXPECT_NEAR(*summarise(log, config).lost_at_s, 0.2, 1e-9);
  for (std::size_t k = 0; k < 400; ++k) log.measurement[k].mode = Mode::kIfRamp;
  EXPECT_NEAR(*summarise(log, config).lost_at_s, 1.5, 1e-9) << "a forced angle is no loss";
  DriveConfig aligned = config;
  aligned.start = Start::kAlignIf;
  log.measurement[0].mode = log.measurement[1].mode = Mode::kRun;  // no command has acted
  put_angle_error(log, 0, 2, 2.0);
  EXPECT_NEAR(*summarise(log, config).lost_at_s, 0, 1e-9);
  EXPECT_NEAR(*summarise(log, aligned).lost_at_s, 1.5, 1e-9) << "nor is that before the alignment";
}

// 20 % off for 19 ticks of 1 ms is allowed, for 20 ticks it is not, consecutive or not. Synchronism
// is another matter.
TEST(Summary, TheSpeedIsNotHeldAfterTwentyMillisecondsOffAConstantReference) {
  const DriveConfig config = steady_drive();
  const auto held_with = [&](int ticks, double share) {
    RunLog log = steady_run(config);
    for (int i = 0; i < ticks; ++i) {
      const std::size_t k = static_cast<std::size_t>(700 + 7 * i);
      log.truth[k].omega_m = kOmegaM * (1 + share);
    }
    const Summary s = summarise(log, config);
    EXPECT_EQ(s.locked, true);
    return s.speed_held;
  };
  EXPECT_EQ(held_with(19, -0.21), true);
  EXPECT_EQ(held_with(20, -0.21), false);
  EXPECT_EQ(held_with(20, 0.21), false);
  EXPECT_EQ(held_with(100, 0.19), true);
}

TEST(Summary, DoesNotJudgeTheSpeedForATenthOfASecondAfterAChangeOfTheReference) {
  const DriveConfig config = steady_drive();
  const auto held_until = [&](std::size_t last) {
    RunLog log = steady_run(config);
    for (std::size_t k = 1000; k < log.command.size(); ++k) log.command[k].omega_m_ref = 100;
    for (std::size_t k = last; k < log.truth.size(); ++k) log.truth[k].omega_m = 100;
    return summarise(log, config).speed_held;
  };
  EXPECT_EQ(held_until(1100), true);
  EXPECT_EQ(held_until(1119), true);
  EXPECT_EQ(held_until(1120), false);
}

TEST(Summary, DoesNotJudgeTheSpeedAtAReferenceOfZero) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  for (Command& c : log.command) c.omega_m_ref = 0;
  const Summary s = summarise(log, config);
  EXPECT_EQ(s.locked, true);
  EXPECT_FALSE(s.speed_held || s.speed_dip_percent || s.speed_unevenness_percent);
}

TEST(Summary, ADipInOneTurnIsADipAndARippleInEveryTurnUnevenness) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  for (std::size_t k = 1000; k < 1050; ++k) log.truth[k].omega_m = 0.65 * kOmegaM;
  Summary s = summarise(log, config);
  EXPECT_EQ(speed_word(s), "dipped");
  EXPECT_NEAR(*s.speed_dip_percent, 35, 1e-9);
  EXPECT_NEAR(*s.speed_excess_percent, 0, 1e-9);
  EXPECT_NEAR(*s.speed_unevenness_percent, 0, 1e-9);
  log = steady_run(config);
  for (std::size_t k = 1000; k < 1050; ++k) log.truth[k].omega_m = 1.4 * kOmegaM;
  s = summarise(log, config);
  EXPECT_EQ(speed_word(s), "overshot");
  EXPECT_NEAR(*s.speed_excess_percent, 40, 1e-9);
  log = steady_run(config);
  for (Truth& t : log.truth) t.omega_m = kOmegaM * (1 + 0.3 * std::sin(3 * t.theta_m));
  s = summarise(log, config);
  EXPECT_EQ(s.locked, true);
  EXPECT_EQ(speed_word(s), "uneven");
  EXPECT_NEAR(*s.speed_unevenness_percent, 60, 2);
  EXPECT_EQ(speed_word(summarise(steady_run(config), config)), "");
}

TEST(Summary, TwoLoadStepsWithinThreeTurnsAreADipAndARippleIsUnevenness) {
  const DriveConfig config = steady_drive();
  const auto with = [&](auto speed) {
    RunLog log = steady_run(config);
    for (std::size_t k = 0; k < log.truth.size(); ++k) {
      log.truth[k].theta_m = 1e-4 * static_cast<double>(k);  // less than three turns
      log.estimate[k].theta_e = wrap_turn(config.machine.n_p * log.truth[k].theta_m);
      log.truth[k].omega_m = kOmegaM * speed(k);
    }
    return summarise(log, config);
  };
  const auto steps = [](std::size_t k) {
    const std::size_t since = k % 700;
    return since < 30 ? 0.5 : since < 60 ? 1.5 : 1.0;
  };
  EXPECT_FALSE(with(steps).speed_unevenness_percent);
  EXPECT_EQ(speed_word(with(steps)), "dipped");
  const auto ripple = [](std::size_t k) { return 1 + 0.3 * std::sin(0.05 * double(k)); };
  EXPECT_EQ(speed_word(with(ripple)), "uneven");
}

TEST(Summary, ATripIsNeverLockedAndTheFirstIsNamed) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  const auto event = [](std::int64_t k, Reason reason) {
    return EventRecord{.k = k,
                       .t_ns = k * 1'000'000,
                       .role = static_cast<int>(Role::kController),
                       .reason = static_cast<int>(reason),
                       .text = "zero voltage"};
  };
  log.events = {event(100, Reason::kModeChange), event(900, Reason::kCommandLost),
                event(300, Reason::kLostSynchronism)};
  const Summary s = summarise(log, config);
  EXPECT_EQ(s.locked, false);
  EXPECT_EQ(s.speed_held, false);
  ASSERT_TRUE(s.trip);
  EXPECT_EQ(s.trip->k, 300);
  EXPECT_EQ(trip_text(*s.trip), "lost_synchronism at 0.3000 s, tick 300, controller: zero voltage");
  EXPECT_NEAR(*s.lost_at_s, 0.3, 1e-9);
  EXPECT_EQ(nlohmann::json::parse(to_json(s, config))["trip"]["reason"], 4);
}

// The figures and the verdict begin when the controller uses the estimate.
TEST(Summary, TheWindowBeginsAtTheHandOverAtTheEarliest) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  put_angle_error(log, 0, 1200, 2.0);
  for (std::size_t k = 1; k < 1200; ++k)
    log.measurement[k].mode = k < 300 ? Mode::kAlign : Mode::kIfRamp;
  Summary s = summarise(log, config);
  EXPECT_EQ(s.locked, true);
  EXPECT_NEAR(s.window_from_s, 1.2, 1e-9);
  EXPECT_NEAR(*s.angle_error_max, 0, 1e-9);
  for (Measurement& m : log.measurement) m.mode = Mode::kIfRamp;
  s = summarise(log, config);
  EXPECT_EQ(s.locked, false);
  EXPECT_NE(s.lost_why.find("hand-over"), std::string::npos);
}

TEST(Summary, IsLostByAStateThatIsNotFinite) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  log.estimate[900].theta_e = kNaN;
  EXPECT_EQ(summarise(log, config).locked, false);
  EXPECT_TRUE(std::isfinite(*summarise(log, config).angle_error_rms));
  log = steady_run(config);
  log.estimate[900].x_hat[5] = 1e200;
  EXPECT_EQ(summarise(log, config).locked, false);
  log = steady_run(config);
  log.truth[900].omega_m = kNaN;
  EXPECT_EQ(summarise(log, config).locked, false);
}

// 1.5 s at 50 rad/s are 11 turns of 126 samples: orders 6 and 30 count as harmonics.
TEST(Summary, RippleIsTheSpeedLessItsMeanAndHarmonicsItsOrders) {
  DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  for (Truth& t : log.truth)
    t.omega_m = kOmegaM + 0.3 * std::sin(6 * t.theta_m) + 0.4 * std::cos(30 * t.theta_m) +
                (t.k % 2 == 0 ? 0.05 : -0.05);
  const Summary s = summarise(log, config);
  EXPECT_NEAR(*s.speed_ripple_harmonics_rms, std::sqrt((0.09 + 0.16) / 2), 2e-3);
  EXPECT_NEAR(*s.speed_ripple_rms, std::sqrt((0.09 + 0.16) / 2 + 0.0025), 2e-3);
}

TEST(Summary, RippleLeavesOrdersAboveSixtyToTheTotalOnly) {
  DriveConfig config = steady_drive();
  config.rates.f_s_Hz = 10000;
  RunLog log = steady_run(config);
  for (Truth& t : log.truth)
    t.omega_m = kOmegaM + 0.3 * std::sin(60 * t.theta_m) + 0.4 * std::sin(61 * t.theta_m);
  const Summary s = summarise(log, config);
  EXPECT_NEAR(*s.speed_ripple_harmonics_rms, 0.3 / std::sqrt(2.0), 3e-3);
  EXPECT_NEAR(*s.speed_ripple_rms, 0.5 / std::sqrt(2.0), 3e-3);
}

TEST(Summary, RippleNeedsThreeTurns) {
  DriveConfig config = steady_drive();
  config.run.settle_s = 2 - 2.9 * kTwoPi / kOmegaM;
  EXPECT_FALSE(summarise(steady_run(config), config).speed_ripple_rms.has_value());
  config.run.settle_s = 2 - 3.1 * kTwoPi / kOmegaM;
  EXPECT_TRUE(summarise(steady_run(config), config).speed_ripple_rms.has_value());
}

TEST(Summary, WithoutTruthTheMeasuredPositionIsTheReference) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  for (Measurement& m : log.measurement) m.theta_m += 0.025;  // 0.1 rad electrical
  EXPECT_NEAR(*summarise(log, config).angle_error_rms, 0, 1e-9);
  const Summary encoder = summarise(log, config, AngleReference::kEncoder);
  EXPECT_NEAR(*encoder.angle_error_rms, 0.1, 1e-9);
  log.truth.clear();
  const Summary s = summarise(log, config);
  EXPECT_EQ(s.angle_reference, AngleReference::kEncoder);
  EXPECT_NEAR(*s.angle_error_rms, 0.1, 1e-9);
  EXPECT_NEAR(*s.speed_error_rms, 0, 1e-9);
  EXPECT_EQ(s.locked, true);
  EXPECT_FALSE(s.speed_ripple_rms.has_value());
}

// 1440 counts at 1 kHz step the tick-to-tick speed by 4.4 rad/s; the slope over 10 ms does not.
TEST(Summary, TheReferenceSpeedAveragesTheQuantisationOfAnEncoder) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  const double step = kTwoPi / 1440;
  for (Measurement& m : log.measurement) m.theta_m = std::floor(m.theta_m / step) * step;
  log.truth.clear();
  EXPECT_LT(*summarise(log, config).speed_error_rms, 0.3);
}

TEST(Summary, WithoutAReferenceAngleThereIsNoVerdict) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  log.truth.clear();
  for (Measurement& m : log.measurement) m.signals = kPhaseCurrents;
  const Summary s = summarise(log, config);
  EXPECT_FALSE(s.locked.has_value());
  EXPECT_FALSE(s.angle_error_rms.has_value());
  EXPECT_EQ(s.angle_reference, AngleReference::kNone);
  const Summary nothing = summarise(RunLog(), config);
  EXPECT_FALSE(nothing.locked.has_value());
  EXPECT_EQ(nothing.steps, 0);
}

TEST(Summary, ARunWithoutHandOverIsNotLockedAndOneThatWasEndedBeforeItsWindowIsNotJudged) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  for (Measurement& m : log.measurement) m.mode = Mode::kIfRamp;
  Summary s = summarise(log, config);
  EXPECT_EQ(s.locked, false);
  EXPECT_EQ(s.lost_why, "no hand-over to the estimate before the end");
  EXPECT_FALSE(s.lost_at_s);
  EXPECT_EQ(nlohmann::json::parse(to_json(s, config))["locked"], false);
  DriveConfig late = config;
  late.run.settle_s = 1e3;
  s = summarise(steady_run(config), late);
  EXPECT_FALSE(s.locked.has_value());
  EXPECT_NE(s.lost_why.find("settle_s"), std::string::npos);
}

TEST(Summary, AMeasuredLogWithoutEstimatesIsNotJudged) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  log.estimate.clear();
  log.gain.clear();
  const Summary s = summarise(log, config);
  EXPECT_FALSE(s.locked.has_value());
  EXPECT_EQ(s.lost_why, "the window has no estimate");
}

TEST(Summary, ASpeedThatNeverCameIsMoreThanADip) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  for (Truth& t : log.truth) t.omega_m = 0.5 * kOmegaM;
  EXPECT_EQ(speed_word(summarise(log, config)), "dipped, never at its reference");
}

// The controller of the drive that is listened to is its own: no COMMAND is in the log.
TEST(Summary, TheEndOfAListeningProcessIsNoTripOfTheDrive) {
  DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  const auto trips = [&](Reason reason, std::vector<Command> commands, PlantKind kind) {
    RunLog one = log;
    one.command = std::move(commands);
    one.events = {{.k = 300, .t_ns = 300'000'000, .reason = static_cast<int>(reason)}};
    config.plant.kind = kind;
    return summarise(one, config).trip.has_value();
  };
  for (const Reason own : {Reason::kProcessDied, Reason::kPeerTimeout, Reason::kDiskFull,
                           Reason::kSupervisorLost, Reason::kEmergencyStop}) {
    EXPECT_FALSE(trips(own, {}, PlantKind::kBridge));
    EXPECT_TRUE(trips(own, log.command, PlantKind::kBridge));
    EXPECT_TRUE(trips(own, {}, PlantKind::kSimulated));
  }
  EXPECT_TRUE(trips(Reason::kDeviceReset, {}, PlantKind::kBridge));
}

TEST(Summary, CountsGainsAndTheirVariance) {
  DriveConfig config = steady_drive();
  const RunLog log = steady_run(config);
  const Summary s = summarise(log, config);
  EXPECT_EQ(s.gains_used, 399);
  // The first gain in the window is that of tick 495, computed before the window.
  EXPECT_NEAR(*s.P44_max, 9.0, 1e-9);
  EXPECT_NEAR(*s.P44_min, 0.405, 1e-9);
  config.estimator.kind = "ekf_disturbance";
  EXPECT_FALSE(summarise(log, config).P44_min.has_value());
}

TEST(Summary, TheVarianceOfTheStartUpDoesNotCount) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  for (GainRecord& g : log.gain) {
    Gain gain{.k = g.k, .n_x = 4, .n_y = 2};
    gain.P(3, 3) = g.k < 495 ? (g.k < 200 ? 0.01 : 100) : 0.7;
    g = gain;
  }
  const Summary s = summarise(log, config);
  EXPECT_NEAR(*s.P44_max, 0.7, 1e-12);
  EXPECT_NEAR(*s.P44_min, 0.7, 1e-12);
}

TEST(Summary, DriveTimeGoesOverTicksThatTheLogLacks) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  log.measurement.erase(log.measurement.begin() + 700, log.measurement.begin() + 1200);
  const Summary s = summarise(log, config);
  EXPECT_EQ(s.steps, 1500);
  EXPECT_DOUBLE_EQ(s.duration_s, 2);
}

TEST(Summary, CountsTicksMissingInTheLog) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  log.estimate.erase(log.estimate.begin() + 700, log.estimate.begin() + 703);
  log.gain.erase(log.gain.begin() + 10);
  log.command.push_back(log.command.back());  // a repeat is no gap
  for (const Measurement& m : log.measurement)
    if (m.k < 200 || m.k > 201) log.reference.push_back({.k = m.k, .t_ns = m.t_ns});
  Summary s = summarise(log, config);
  EXPECT_EQ(s.lost_messages["DRIVE_REFERENCE"], 2);
  DriveConfig foreign = config;
  foreign.reference.from_bus = true;
  EXPECT_EQ(summarise(log, foreign).lost_messages.count("DRIVE_REFERENCE"), 0u);
  EXPECT_EQ(s.lost_messages["DRIVE_ESTIMATE"], 3);
  EXPECT_EQ(s.lost_messages["DRIVE_GAIN"], 1);
  EXPECT_EQ(s.lost_messages["DRIVE_COMMAND"], 0);
  EXPECT_EQ(s.lost_messages["DRIVE_MEASUREMENT"], 0);
}

// A recorder may be started late: settle_s counts from the log's first tick.
TEST(Summary, TheSettleTimeCountsFromTheFirstTickOfTheLog) {
  const DriveConfig config = steady_drive();
  RunLog log = steady_run(config);
  put_angle_error(log, 0, 500, 1.6);
  put_angle_error(log, 500, 2000, 0.1);
  const Summary early = summarise(log, config);
  constexpr std::int64_t kLate = 10'000;  // ticks
  for (Measurement& m : log.measurement) m.k += kLate, m.t_ns += config.t_ns(kLate);
  for (Truth& t : log.truth) t.k += kLate, t.t_ns += config.t_ns(kLate);
  for (Estimate& e : log.estimate) e.k += kLate, e.t_ns += config.t_ns(kLate);
  for (Command& c : log.command) c.k += kLate, c.t_ns += config.t_ns(kLate);
  const Summary late = summarise(log, config);
  EXPECT_EQ(late.locked, true);
  EXPECT_NEAR(*late.angle_error_max, 0.1, 1e-9);
  EXPECT_NEAR(*late.angle_error_rms, *early.angle_error_rms, 1e-12);
}

}  // namespace
}  // namespace twinrate
