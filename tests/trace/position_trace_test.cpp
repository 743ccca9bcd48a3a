// Logs of angle and current from an independent motor model, without code of the product's plant.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "model/random.hpp"
#include "trace/keys.hpp"
#include "trace/measured_result.hpp"
#include "trace/motion.hpp"
#include "trace/winding_voltage.hpp"

namespace twinrate {
namespace {

constexpr double kTurn = 6.283185307179586;

// 12 pole pairs, K_t = 0.0275 Nm/A.
MachineParameters machine() {
  return {.R_s = 0.53,
          .L_d = 2e-4,
          .L_q = 2e-4,
          .psi_f = 0.0275 / 18,
          .J = 5e-6,
          .B = 0,
          .n_p = 12,
          .n_slots = 18};
}

struct Truth {
  double J = 5e-6, T_C = 1.5e-3, R = 0.50;
  double A_72 = 5e-3, phase_72 = 0.7, A_18 = 1.2e-3, phase_18 = -1.1;
  double ripple = 0.02;                // V, once an electrical turn
  double delay = 8e-4, filter = 1e-3;  // s, of the logged speed
  double cogging(double theta_m) const {
    return A_72 * std::sin(72 * theta_m + phase_72) + A_18 * std::sin(18 * theta_m + phase_18);
  }
};

// Forward and back over one turn, at rest at every row.
PositionLog sweep(const Truth& truth, bool back = true, double current_lag = 0) {
  PositionLog log{.path = "sweep"};
  const int rows = 6000;
  double held = 0;
  for (int k = 0; k < rows; ++k) {
    const double share = k / (rows - 1.0);
    const double theta_m =
        back ? kTurn * (share < 0.5 ? 2 * share : 2 - 2 * share) : 2 * kTurn * share;
    const double direction = !back || share < 0.5 ? 1 : -1;
    const auto n = static_cast<std::uint64_t>(k);
    log.t.push_back(1e-2 * k + 2e-4 * uniform(1, 0, n));
    log.theta_m.push_back(theta_m + 2e-4 * normal(1, 1, n));
    const double i_q = (truth.cogging(theta_m) + direction * truth.T_C) / 0.0275;
    held = k == 0 || current_lag == 0 ? i_q
                                      : held + (i_q - held) * (1 - std::exp(-1e-2 / current_lag));
    log.i_q.push_back(held + 0.01 * normal(1, 2, n));
    log.u_q.push_back(truth.R * log.i_q.back() + truth.ripple * std::sin(12 * theta_m + 0.3) +
                      0.005 * normal(1, 3, n));
  }
  return log;
}

// The rotor with a current, in steps of 20 us; rows at about 1 ms, time stamps of 0.1 ms.
template <class Current>
PositionLog run(const Truth& truth, double duration, double angle_offset, std::uint64_t seed,
                Current current) {
  constexpr double kStep = 2e-5;
  PositionLog log{.path = "run"};
  double theta_m = 0.3, omega_m = 0, shown = 0, next = 0;
  std::vector<double> late(static_cast<std::size_t>(truth.delay / kStep) + 1, 0);
  std::uint64_t rows = 0;
  const auto steps = static_cast<std::size_t>(duration / kStep);
  for (std::size_t step = 0; step < steps; ++step) {
    const double t = kStep * static_cast<double>(step), i_q = current(t, theta_m, omega_m);
    if (t >= next) {
      ++rows;
      next = 1e-3 * static_cast<double>(rows) + 2e-4 * (uniform(seed, 0, rows) - 0.5);
      log.t.push_back(std::round(t * 1e4) / 1e4);
      log.theta_m.push_back(theta_m + angle_offset);
      log.omega_m.push_back(shown);
      log.i_q.push_back(i_q + 0.01 * normal(seed, 1, rows));
      log.u_q.push_back(truth.R * i_q + 0.01833 * omega_m + 0.01 * normal(seed, 2, rows));
    }
    const double push = 0.0275 * i_q - truth.cogging(theta_m);
    const double friction = std::abs(omega_m) < 1e-3 && std::abs(push) < truth.T_C
                                ? push
                                : truth.T_C * std::tanh(omega_m / 0.02);
    omega_m += kStep * (push - friction) / truth.J;
    theta_m += kStep * omega_m;
    late[step % late.size()] = omega_m;
    shown += kStep / truth.filter * (late[(step + 1) % late.size()] - shown);
  }
  return log;
}

PositionLog swing(const Truth& truth) {
  return run(truth, 12, 0.123, 7,
             [](double t, double, double) { return 0.4 * std::sin(kTurn * 2 * t); });
}
// A slow speed loop, on the angle of the sweep.
PositionLog turning(const Truth& truth) {
  return run(truth, 5, 0, 8, [](double t, double, double omega_m) {
    return 0.06 + 0.02 * (std::min(10.0, 20 * t) - omega_m);
  });
}

TEST(HoldingTorque, FindsCoggingAndFrictionOfASweep) {
  const Truth truth;
  const PositionLog log = sweep(truth);
  const std::vector<const PositionLog*> logs{&log};
  ASSERT_TRUE(is_quasi_static(log, machine()));
  const HoldingTorque found = trace_holding_torque(logs, machine());
  ASSERT_EQ(found.cogging.size(), 2u);
  EXPECT_EQ(found.cogging[0].order, 72);
  EXPECT_NEAR(found.cogging[0].amplitude, truth.A_72, 5 * found.cogging[0].sigma_amplitude);
  EXPECT_NEAR(found.cogging[0].phase, truth.phase_72, 0.02);
  EXPECT_EQ(found.cogging[1].order, 18);
  EXPECT_NEAR(found.cogging[1].phase, truth.phase_18, 0.02);
  EXPECT_TRUE(found.both_directions);
  EXPECT_NEAR(found.T_C, truth.T_C, 0.03e-3);
  EXPECT_EQ(found.lag, 0);
  EXPECT_TRUE(found.friction_ripple.empty());
}

// Noise of one size, white or with a correlation of 0.9 from row to row: the mean of the latter scatters
// by sqrt(1.9/0.1) = 4.4 more.
TEST(HoldingTorque, NoiseThatLastsOverRowsMakesItsSigmasLarger) {
  constexpr double kCorrelation = 0.9, kRms_A = 0.1;
  PositionLog white = sweep({}), lasting = white;
  double x = 0;
  for (std::size_t k = 0; k < white.size(); ++k) {
    const double now = kRms_A * normal(21, 0, k);
    x = kCorrelation * x + std::sqrt(1 - kCorrelation * kCorrelation) * now;
    white.i_q[k] += now;
    lasting.i_q[k] += x;
  }
  const auto sigma = [](const PositionLog& log) {
    return trace_holding_torque(std::vector<const PositionLog*>{&log}, machine()).sigma_T_C;
  };
  EXPECT_GT(sigma(lasting), 3.5 * sigma(white));
  EXPECT_LT(sigma(lasting), 5.5 * sigma(white));
}

// At constant speed there is no acceleration, but the current is no holding current.
TEST(Positions, ASteadySpeedIsNoHolding) {
  PositionLog log{.path = "steady"};
  for (int k = 0; k < 40000; ++k) {
    const double t = 1e-4 * k, load = std::fmod(t, 1.0) < 0.5 ? 0.5 : 1.5;
    log.t.push_back(t);
    log.theta_m.push_back(90 * t + 1e-3 * std::sin(3 * t));
    log.i_q.push_back(load + 0.01 * normal(3, 0, static_cast<std::uint64_t>(k)));
  }
  EXPECT_FALSE(is_quasi_static(log, machine()));
  EXPECT_TRUE(is_drive_log(log, machine()));
  PositionLog slow = sweep({});
  EXPECT_FALSE(is_drive_log(slow, machine()));
  PositionLog sparse = swing({});
  EXPECT_TRUE(is_drive_log(sparse, machine())) << "1 kHz";
}

TEST(Positions, AnUnexplainedResidualIsNotNothingMissing) {
  PositionLog log{.path = "drifts"};
  PositionLog quiet{.path = "quiet"};
  for (std::uint64_t k = 0; k < 6000; ++k) {
    const double share = static_cast<double>(k) / 5999;
    for (PositionLog* to : {&log, &quiet}) {
      to->t.push_back(1e-2 * static_cast<double>(k));
      to->theta_m.push_back(kTurn * (share < 0.5 ? 2 * share : 2 - 2 * share));
      to->i_q.push_back(0.01 * normal(5, 0, k));
    }
    log.i_q.back() += 0.3 * std::sin(5.3 * log.t.back() + 0.02 * log.t.back() * log.t.back());
  }
  const auto trace = [](const PositionLog& one) {
    return trace_positions({one}, {.machine = machine(), .v_dc = 24});
  };
  const TraceResult r = trace(log);
  ASSERT_TRUE(r.effects.empty()) << r.sentence;
  EXPECT_EQ(r.verdict, "ambiguous") << r.sentence;
  EXPECT_EQ(r.sentence.find("Cannot tell"), 0u) << r.sentence;
  EXPECT_EQ(trace(quiet).verdict, "nothing_missing");
}

TEST(Positions, CurrentsInMilliamperesAreNoneOfThisDrive) {
  MachineParameters known = machine();
  known.i_rated = 0.5;
  PositionLog log = sweep({});
  EXPECT_NE(trace_positions({log}, {.machine = known, .v_dc = 24}).verdict, "inconsistent");
  for (double& i_q : log.i_q) i_q *= 1e3;
  const TraceResult r = trace_positions({log}, {.machine = known, .v_dc = 24});
  EXPECT_EQ(r.verdict, "inconsistent");
  EXPECT_NE(r.sentence.find("milliamperes?"), std::string::npos) << r.sentence;
  EXPECT_TRUE(r.effects.empty());
  PositionLog good = sweep({});
  good.path = "good.csv";
  log.path = "milli.csv";
  EXPECT_TRUE(trace_positions({good, log}, {.machine = known, .v_dc = 24})
                  .sentence.starts_with("milli.csv and the drive file do not belong together: "));
}

// Forward and back at speeds up to 0.2 rad/s, with a friction that falls by a share of itself.
TEST(HoldingTorque, AFrictionThatFallsWithTheSpeedHasTwoNames) {
  const auto trace = [](double fall) {
    PositionLog log{.path = "sweep"};
    for (std::uint64_t k = 0; k < 6000; ++k) {
      const double t = 1e-2 * static_cast<double>(k), turn = kTurn * t / 60,
                   speed = std::abs(std::sin(turn));
      log.t.push_back(t);
      log.theta_m.push_back(2 * (1 - std::cos(turn)) + 1e-5 * normal(6, 0, k));
      log.i_q.push_back((turn < kTurn / 2 ? 1 : -1) * 1.5e-3 * (1 - fall * speed) / 0.0275 +
                        0.005 * normal(6, 1, k));
    }
    return trace_positions(hold_out({log}, 0.25, machine()), {.machine = machine(), .v_dc = 24});
  };
  for (const double fall : {0.0, 0.04, 0.4}) {
    const TraceResult r = trace(fall);
    ASSERT_EQ(r.effects.size(), 1u) << r.sentence;
    EXPECT_EQ(r.effects[0].effect->kind(), "coulomb_friction");
    EXPECT_EQ(r.verdict, fall > 0.1 ? "ambiguous" : "traced") << fall;
    EXPECT_EQ(r.effects[0].aliases.size(), fall > 0.1 ? 1u : 0u) << fall;
    if (fall < 0.1) continue;
    ASSERT_FALSE(r.ambiguous.empty()) << r.sentence;
    EXPECT_EQ(r.ambiguous[0].why.find("the friction falls by 4"), 0u) << r.ambiguous[0].why;
    EXPECT_EQ(r.sentence.find("Ambiguous"), 0u) << r.sentence;
  }
}

TEST(HoldingTorque, OneWayLeavesFrictionUnnamed) {
  const PositionLog log = sweep({}, false);
  const std::vector<const PositionLog*> logs{&log};
  const HoldingTorque found = trace_holding_torque(logs, machine());
  EXPECT_FALSE(found.both_directions);
  EXPECT_EQ(found.T_C, 0);
  const TraceResult result = trace_positions({log}, {.machine = machine(), .v_dc = 24});
  const auto named = [&](std::string_view kind) {
    return std::any_of(result.effects.begin(), result.effects.end(),
                       [&](const TracedEffect& e) { return e.effect->kind() == kind; });
  };
  EXPECT_TRUE(named("cogging"));
  EXPECT_FALSE(named("coulomb_friction"));
  ASSERT_FALSE(result.ambiguous.empty());
  EXPECT_EQ(result.ambiguous[0].kinds[0], "coulomb_friction");
}

// The map at rest gives the current; its delay in a run shows the filter.
TEST(HoldingTorque, FindsTheFilterOfALoggedCurrent) {
  const Truth truth;
  PositionLog map = sweep(truth, false);
  map.t.clear();
  const PositionLog slow = sweep(truth, false, 0.08);
  const std::vector<const PositionLog*> logs{&map, &slow};
  const HoldingTorque found = trace_holding_torque(logs, machine());
  EXPECT_NEAR(found.lag, 0.08, 0.007) << "half a row of 10 ms";
  ASSERT_FALSE(found.cogging.empty());
  EXPECT_NEAR(found.cogging[0].amplitude, truth.A_72, 0.02 * truth.A_72);
}

TEST(Motion, FindsTheRatioOfTorqueConstantAndInertia) {
  const Truth truth;
  const PositionLog log = swing(truth);
  ASSERT_FALSE(is_quasi_static(log, machine()));
  const std::vector<const PositionLog*> logs{&log};
  const SpinUp spin = fit_spin_up(logs, machine());
  EXPECT_NEAR(spin.gain, 0.0275 / truth.J, 0.01 * 0.0275 / truth.J);
  EXPECT_NEAR(spin.T_C, truth.T_C, 0.1e-3);
}

TEST(Motion, FindsHowLateTheShownSpeedIs) {
  const Truth truth;
  const SpeedLag lag = fit_speed_lag(swing(truth));
  EXPECT_NEAR(lag.lag(), truth.delay + truth.filter, 0.1e-3);
  EXPECT_NEAR(lag.filter, truth.filter, 0.4e-3);
  EXPECT_LT(lag.rest, 0.3 * lag.rest_without);
}

TEST(WindingVoltage, IsUnbiasedByALateSpeed) {
  const Truth truth;
  const PositionLog rest = sweep(truth), motion = swing(truth);
  const std::vector<const PositionLog*> at_rest{&rest}, in_motion{&motion};
  const WindingVoltage found = trace_winding_voltage(at_rest, in_motion, machine());
  EXPECT_NEAR(found.R, truth.R, 0.01);
  EXPECT_GT(found.R_by_logged_speed, truth.R + 0.1) << "a lag in phase with the current";
  ASSERT_EQ(found.ripple.size(), 1u);
  EXPECT_EQ(found.ripple[0].order, 12);
  EXPECT_NEAR(found.ripple[0].amplitude, truth.ripple, 0.001);
}

TEST(StepMeans, AreTheIntegralOverEachStep) {
  const std::vector<double> theta_m{0.1, 0.4, 0.4, 0.35};
  const std::vector<double> mean = step_means(theta_m, 50, 0.2);
  ASSERT_EQ(mean.size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) {
    double sum = 0;
    for (int j = 0; j < 20000; ++j)
      sum += std::sin(50 * (theta_m[k] + (j + 0.5) / 20000 * (theta_m[k + 1] - theta_m[k])) + 0.2);
    EXPECT_NEAR(mean[k], sum / 20000, 1e-6);
  }
}

TEST(Positions, PredictARunThatWasNotFitted) {
  const Truth truth;
  PositionLog unseen = turning(truth);
  unseen.held_out = true;
  const TraceResult r =
      trace_positions({sweep(truth), swing(truth), unseen}, {.machine = machine(), .v_dc = 24});
  EXPECT_EQ(r.verdict, "traced");
  ASSERT_TRUE(r.mechanical.has_value());
  EXPECT_EQ(r.mechanical->unit, "rad/s");
  EXPECT_NEAR(r.horizon_s, 5e-3, 1e-4);
  EXPECT_LT(r.mechanical->after.held_out, 0.3 * r.mechanical->no_change);
  EXPECT_LT(r.mechanical->after.held_out, 0.6 * r.mechanical->before.held_out);
  EXPECT_GT(r.mechanical->before.held_out, 0.4 * r.mechanical->no_change);
  ASSERT_FALSE(r.effects.empty());
  EXPECT_EQ(r.effects[0].effect->kind(), "cogging");
  EXPECT_EQ(get_key(*r.effects[0].effect, "order"), 72);
  EXPECT_GT(r.effects[0].held_out_gain, 0.5);
  for (const TracedEffect& e : r.effects) EXPECT_LT(e.delta_bic, 0) << e.effect->kind();
  ASSERT_EQ(r.files.size(), 2u);  // the two runs
  // One file is held out: its errors are those of the held-out rows.
  const FileError& file = r.files[0].held_out ? r.files[0] : r.files[1];
  EXPECT_TRUE(file.held_out);
  EXPECT_NEAR(file.before, r.mechanical->before.held_out, 1e-9);
  EXPECT_NEAR(file.after, r.mechanical->after.held_out, 1e-9);
}

// R_s is 0.03 Ohm below the declared one, in all rows and then not in those that judge.
TEST(Positions, AResistanceIsClaimedWhereTheRowsThatJudgeHaveIt) {
  const Truth truth;
  std::vector<PositionLog> logs = hold_out({sweep(truth)}, 0.25, machine());
  const DriveFacts drive{.machine = machine(), .v_dc = 24};
  const auto resistance = [](const TraceResult& r) {
    const auto it = std::find_if(r.effects.begin(), r.effects.end(), [](const TracedEffect& e) {
      return e.effect->kind() == "resistance";
    });
    return it == r.effects.end() ? 0.0 : get_key(*it->effect, "change_Ohm");
  };
  EXPECT_NEAR(resistance(trace_positions(logs, drive)), -0.03, 0.005);

  for (std::size_t k = 0; k < logs[0].size(); ++k)
    if (logs[0].judges[k]) logs[0].u_q[k] += (machine().R_s - truth.R) * logs[0].i_q[k];
  const TraceResult refused = trace_positions(logs, drive);
  EXPECT_EQ(resistance(refused), 0);
  EXPECT_TRUE(std::any_of(refused.refused.begin(), refused.refused.end(), [](const Refused& claim) {
    return claim.kind == "resistance" && claim.rule == "transfer";
  }));
}

// Order 72 is in the picture before and gone after.
TEST(Positions, ThePicturesShowWhatTheModelTakesAway) {
  const Truth truth;
  const TraceResult r = trace_positions(hold_out({sweep(truth)}, 0.25, machine()),
                                        {.machine = machine(), .v_dc = 24});
  ASSERT_EQ(r.pictures.size(), 2u);
  const TracePicture &rows = r.pictures[0], &orders = r.pictures[1];
  EXPECT_TRUE(std::is_sorted(rows.x.begin(), rows.x.end()));
  EXPECT_NEAR(static_cast<double>(std::count(rows.held_out.begin(), rows.held_out.end(), 1)),
              0.25 * static_cast<double>(rows.x.size()), 0.05 * static_cast<double>(rows.x.size()));
  ASSERT_GE(orders.x.size(), 72u);
  EXPECT_EQ(orders.x[71], 72);
  EXPECT_NEAR(orders.before[71], truth.A_72 / 0.0275, 0.03 * truth.A_72 / 0.0275);
  EXPECT_LT(orders.after[71], 0.05 * orders.before[71]);
  EXPECT_LT(orders.after[17], 0.2 * orders.before[17]);
}

// If a moving run shows no slow filter of the current, a lag at rest is no filter of the log.
TEST(Positions, ALagThatTheMovingRotorDoesNotShowIsNoFilter) {
  const Truth truth;
  PositionLog map = sweep(truth, false);
  map.t.clear();
  const TraceResult r = trace_positions({map, sweep(truth, false, 0.08), swing(truth)},
                                        {.machine = machine(), .v_dc = 24});
  for (const TracedEffect& e : r.effects) {
    if (e.effect->kind() != "signal_lag") continue;
    EXPECT_EQ(get_key(*e.effect, "signal"), 3);
  }
}

// Requests a stop from the n-th call on; counts the calls.
struct StopAt {
  int after = 1 << 30;
  std::shared_ptr<int> asked = std::make_shared<int>(0);
  bool operator()() const { return ++*asked > after; }
};

TEST(Positions, StoppedBeforeTheHoldingTorqueNothingIsKept) {
  const Truth truth;
  EXPECT_THROW(trace_positions({sweep(truth)}, {.machine = machine(), .v_dc = 24},
                               {.hooks = {.say = {}, .stop = StopAt{0}}}),
               TraceStopped);
}

TEST(Positions, StoppedLaterItsResultsAreKeptAndReportedAsNotFullyJudged) {
  const Truth truth;
  const std::vector<PositionLog> logs = hold_out({sweep(truth)}, 0.25, machine());
  const DriveFacts drive{.machine = machine(), .v_dc = 24};
  const StopAt whole;
  const TraceResult all = trace_positions(logs, drive, {.hooks = {.say = {}, .stop = whole}});
  EXPECT_FALSE(all.interrupted);
  ASSERT_GE(all.effects.size(), 3u);

  bool holding = false;
  TraceHooks hooks{.say = [&](const std::string& line) { holding |= line.find("holding") == 0; },
                   .stop = [&] { return holding; }};
  const TraceResult early = trace_positions(logs, drive, {.hooks = hooks});
  EXPECT_TRUE(early.interrupted);
  EXPECT_EQ(early.sentence.find("Interrupted"), 0u) << early.sentence;
  EXPECT_EQ(early.sentence.find("nan"), std::string::npos) << early.sentence;
  ASSERT_FALSE(early.effects.empty());
  EXPECT_EQ(get_key(*early.effects[0].effect, "order"), 72);
  EXPECT_EQ(get_key(*early.effects[0].effect, "amplitude_Nm"),
            get_key(*all.effects[0].effect, "amplitude_Nm"));
  EXPECT_TRUE(std::isnan(early.effects[0].held_out_gain));
  EXPECT_TRUE(early.files.empty());

  // Among the last calls: the first effect is judged, the errors are not computed.
  const TraceResult late =
      trace_positions(logs, drive, {.hooks = {.say = {}, .stop = StopAt{*whole.asked - 4}}});
  EXPECT_TRUE(late.interrupted);
  EXPECT_EQ(late.effects.size(), all.effects.size());
  EXPECT_EQ(late.effects[0].held_out_gain, all.effects[0].held_out_gain);
}

}  // namespace
}  // namespace twinrate
